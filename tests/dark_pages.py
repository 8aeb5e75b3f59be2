"""White boxes on a page in a dark scheme."""

import io

import numpy as np
from PIL import Image
from playwright.sync_api import Page

TILE = 40  # pixels
WHITE = 230


def white_boxes(page: Page) -> int:
    """The number of squares of 40 pixels without anything dark, of the whole page."""
    with Image.open(io.BytesIO(page.screenshot(full_page=True))) as shot:
        pixels = np.asarray(shot.convert("L"))
    rows, columns = (length // TILE for length in pixels.shape)
    tiles = pixels[: rows * TILE, : columns * TILE].reshape(rows, TILE, columns, TILE)
    return int((tiles.min(axis=(1, 3)) > WHITE).sum())
