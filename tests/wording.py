"""What a message says, whatever its wording: the numbers, names and key words that it holds, in their order."""

import re


def says(text: str, *parts: str) -> bool:
    """Whether a text holds all parts, one after the other; spaces and line ends count alike."""
    return re.search(".*?".join(map(re.escape, parts)), " ".join(text.split()), re.IGNORECASE) is not None


def told(messages: list[str], expected: list[str]) -> bool:
    """Compare messages one by one; an expected one that ends in `...` is a prefix."""
    return len(messages) == len(expected) and all(
        message.startswith(one[:-3]) if one.endswith("...") else message == one
        for message, one in zip(messages, expected, strict=True)
    )
