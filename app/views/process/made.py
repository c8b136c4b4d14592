"""What a stage made, or has made so far, in words."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication


def told_made(stage: str, facts: Mapping[str, Any]) -> str:
    """Of the numbers that the child answered."""
    told = QCoreApplication.translate
    return {
        "hdr": told("Made", "{views} photographs of {width} \u00d7 {height} pixels; twelve of them"),
        "segment": told("Made", "The object covers {share:.1%} of the picture"),
        "poses": told(
            "Made", "{placed} of {views} cameras placed, {off_px:.2g} pixels off in the mean; seen from above"
        ),
        "light": told(
            "Made", "{gaussians} Gaussians and {lamps} lamps: the room as it lights the object, logarithmic"
        ),
        "surface": told(
            "Made",
            "Normals and albedo of {pixels} pixels; standard error of the normals {stderr_deg:.2g}\u00b0 in the median",
        ),
        "export": told("Made", "{files} files for other programs"),
    }[stage].format(**facts)
