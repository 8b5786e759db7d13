"""The formats of `robotmodels.export`, and how their files end."""

from typing import Literal

Format = Literal["mjcf", "urdf", "state_space", "modes", "robot"]
ENDINGS: dict[Format, str] = {
    "mjcf": ".xml",
    "urdf": ".urdf",
    "state_space": ".mat",
    "modes": ".modes.json",
    "robot": ".yaml",
}
