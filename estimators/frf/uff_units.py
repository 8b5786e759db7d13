"""What functions of universal files say of their axes: types, units and directions, obeyed or not.

Files name units by a label, by dataset 164 for the whole file, or not at all, which means SI.
"""

from typing import Any

import numpy as np

from robotmodels.common.errors import InvalidInput

FREQUENCY, ACCELERATION = 18, 12
_UNSAID = (0, 1)  # unknown, general
_FORCES = (9, 13)  # excitation and reaction force, or moments for rotations
_MOST_DIRECTION = 6  # translations 1 to 3 and rotations 4 to 6, with a sign; 0 is a scalar
_TURN = 2 * np.pi

_FREQUENCIES = {"hz": _TURN, "1/s": _TURN, "cps": _TURN, "khz": 1e3 * _TURN, "rpm": _TURN / 60}
_FREQUENCIES |= {"rad/s": 1.0, "rad/sec": 1.0}
_ANGULAR = {"rad/s^2": 1.0, "deg/s^2": np.pi / 180, "rev/s^2": _TURN, "mrad/s^2": 1e-3}
_LINEAR = {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": 9.80665}
_TORQUES = {"nm": 1.0, "knm": 1e3, "ncm": 1e-2, "nmm": 1e-3}  # no mnm: milli or mega
_SEPARATORS = " .*·-()[]"
_WRITTEN = {"sec": "s", "s2": "s^2", "s²": "s^2", "°": "deg"}  # without separators
_NO_UNIT = ("", "none", "unknown", "nounit")

_SI, _UNIT_LABELS = 1, ("length", "force")


def frequency_factor(function: dict[str, Any], who: str) -> float:
    """Return what makes rad/s of a function's abscissa: 2 pi for Hz and where no unit is said.

    Raises
    ------
    InvalidInput
        Naming what the abscissa is instead.
    """
    kind = function["abscissa_spec_data_type"]
    if kind not in (*_UNSAID, FREQUENCY):
        raise InvalidInput(f"{who}: abscissa of type {kind}; frequencies ({FREQUENCY}) are needed")
    return _factor(function, "abscissa", _FREQUENCIES, who, _TURN)


def response_factor(function: dict[str, Any], who: str) -> float:
    """Return what makes rad/s^2 (m/s^2) over N m of an FRF: units and signs of both directions.

    Raises
    ------
    InvalidInput
        Naming the type, unit or direction that is not one of an FRF from torque to acceleration.
    """
    kind, divisor = function["ordinate_spec_data_type"], function["orddenom_spec_data_type"]
    if kind not in (*_UNSAID, ACCELERATION):
        raise InvalidInput(
            f"{who}: ordinate of type {kind}; accelerations ({ACCELERATION}) are needed"
        )
    if divisor not in (*_UNSAID, *_FORCES):
        raise InvalidInput(
            f"{who}: denominator of type {divisor}; torques (type 13 or 9) are needed"
        )
    signs = 1.0
    for key in ("rsp_dir", "ref_dir"):
        direction = function[key]
        if abs(direction) > _MOST_DIRECTION:
            raise InvalidInput(f"{who}: {key} {direction}; -6 to 6 are needed")
        signs *= -1.0 if direction < 0 else 1.0
    motion = _factor(function, "ordinate", _ANGULAR | _LINEAR, who)
    return signs * motion / _factor(function, "orddenom", _TORQUES, who)


def check_unit_system(units: list[dict[str, Any]]) -> None:
    """Refuse files whose dataset 164 says other units than SI.

    Raises
    ------
    InvalidInput
        Quoting the units and factors.
    """
    for one in units:
        factors = [float(one.get(key, 1.0)) for key in _UNIT_LABELS]
        if one.get("units_code", _SI) != _SI or factors != [1.0, 1.0]:
            raise InvalidInput(
                f"units (dataset 164): code {one.get('units_code')}, "
                f"{str(one.get('units_description', '')).strip()[:40]!r}, "
                f"factors of length {factors[0]:g} and force {factors[1]:g}; export in SI (code 1)"
            )


def _factor(
    function: dict[str, Any], axis: str, units: dict[str, float], who: str, unsaid: float = 1.0
) -> float:
    """Return the factor of an axis's unit label."""
    label = str(function.get(f"{axis}_axis_units_lab") or "").strip()
    plain = "".join(letter for letter in label.lower() if letter not in _SEPARATORS)
    for written, meant in _WRITTEN.items():
        plain = plain.replace(written, meant)
    if plain in _NO_UNIT:
        return unsaid
    if plain not in units:
        names = {"abscissa": "abscissa", "ordinate": "ordinate", "orddenom": "denominator"}
        raise InvalidInput(
            f"{who}: {names[axis]} in {label[:40]!r}; possible are {', '.join(units)}"
        )
    return units[plain]
