"""The colors of films, plots and the page.

Color-blind people can tell the colors of Okabe and Ito's palette apart.
"""

from __future__ import annotations

BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
ORANGE = "#E69F00"
PURPLE = "#CC79A7"
SKY_BLUE = "#56B4E9"
YELLOW = "#F0E442"
"""Okabe and Ito's palette without its black; the green is bluish, and the purple is reddish."""
GRAY = "#666666"
"""The color of all that has no color of its own."""
INK = "#282D37"
"""The color of texts and marks."""
EXPERT_COLOR = BLUE
POLICY_COLOR = VERMILION
"""The colors of whoever drives."""


def rgb(color: str) -> tuple[int, int, int]:
    """Red, green and blue of a color, 0 to 255.

    Args:
        color: The color, as those of this module.
    """
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue
