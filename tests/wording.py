"""What a message says, whatever its wording: the numbers, names and key words that it holds, in their order."""

import re


def says(text: str, *parts: str) -> bool:
    """Whether a text holds all parts, one after the other; spaces and line ends count alike."""
    return re.search(".*?".join(map(re.escape, parts)), " ".join(text.split()), re.IGNORECASE) is not None
