"""Numbers and units as people read them: sensible digits, engineering prefixes, Hz and degrees."""

import math
import re
from collections.abc import Sequence

import numpy as np

from robotmodels.common.arrays import Array

THIN = "\u202f"  # narrow no-break space
MINUS = "\u2212"
NO_BREAK = "\u00a0"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"))


def fixed(value: float, decimals: int) -> str:
    """Return a number with so many decimals, spaces between thousands and a true minus sign."""
    text = f"{value:z,.{max(decimals, 0)}f}".replace(",", THIN)
    return text.replace("-", MINUS)


def significant(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, in powers of ten where that is shorter."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 6:
        return fixed(value, digits - 1 - exponent)
    mantissa = fixed(value / 10.0**exponent, digits - 1)
    return f"{mantissa}{THIN}×{THIN}10{str(exponent).translate(_SUPERSCRIPT)}"


def count(number: int) -> str:
    """Return a whole number with spaces between thousands."""
    return fixed(number, 0)


def plural(number: int, noun: str) -> str:
    """Return ``1 position`` or ``13 positions``."""
    return f"{count(number)} {noun}{'' if number == 1 else 's'}"


def percent(fraction: float) -> str:
    """Return a fraction as a percentage of two significant digits."""
    return f"{significant(100 * fraction, 2)}{THIN}%"


def probability(value: float) -> str:
    """Return a probability with two significant digits, or that it is next to none."""
    return significant(value, 2) if value >= 1e-4 or not math.isfinite(value) else "< 0.0001"


def one_and(excess: float) -> str:
    """Return ``1 + 2.4e-10``, or that nothing is above one."""
    if excess <= 1e-15:
        return "1, to rounding,"
    return f"1{NO_BREAK}+{NO_BREAK}{significant(excess, 2)}"


def efficiency(fraction: float) -> str:
    """Return an efficiency as a percentage, never rounded up: it is a certified lower bound."""
    return f"{fixed(math.floor(1e4 * fraction + 1e-6) / 100, 2)}{THIN}%"


def pretty_unit(unit: str) -> str:
    """Return ``kg m²`` for ``kg m^2``."""
    return unit.replace("^2", "²").replace("^3", "³")


def scaled_unit(value: float, unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which `value` reads best, ``kN m/rad`` for 4e4 N m/rad."""
    if unit.startswith("N"):
        for factor, prefix in _PREFIXES:
            if abs(value) >= factor:
                return factor, prefix + pretty_unit(unit)
    return 1.0, pretty_unit(unit)


def decimals_for(std: float) -> int:
    """Return the decimals that show two significant digits of a standard deviation."""
    if not (math.isfinite(std) and std > 0):
        return 3
    return max(1 - math.floor(math.log10(float(f"{std:.1e}"))), 0)


def hertz(omega: float) -> str:
    """Return an angular frequency [rad/s] in Hz."""
    return f"{significant(omega / (2 * math.pi), 3)}{THIN}Hz"


def degrees(position: Array) -> list[str]:
    """Return angles [rad] in whole degrees."""
    return [fixed(float(a), 0) + "°" for a in np.degrees(position)]


def format_position(position: Array, prismatic: Sequence[bool]) -> list[str]:
    """Return a position's angles [rad] in whole degrees, and of prismatic joints the way [m]."""
    return [
        f"{fixed(float(way), 3)}{THIN}m" if straight else degree
        for way, straight, degree in zip(position, prismatic, degrees(position), strict=True)
    ]


def duration(seconds: float) -> str:
    """Return a time as ``0.4 s``, ``12 s`` ``< 0.1 s``, ``3 min 5 s`` or ``16 min``."""
    if 0 < seconds < 0.05:
        return f"< 0.1{THIN}s"
    if seconds < 10:
        return f"{seconds:.1f}{THIN}s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole}{THIN}s"
    if whole >= 600:
        return f"{round(seconds / 60)}{THIN}min"
    return f"{whole // 60}{THIN}min {whole % 60}{THIN}s"


def sentence(words: str) -> str:
    """Return words that begin with a capital letter, unless with a file's name or a command."""
    first = words.split(" ", 1)[0].rstrip(":,;")
    plain = first.isalpha() and first != "oed"
    return f"{words[:1].upper() if plain else words[:1]}{words[1:]}"


def typeset(words: str) -> str:
    """Return plain words of a message as a page prints them: ±, minus and powers of ten."""
    powers = re.sub(
        r"(?<=\d)e([-+]?\d+)",
        lambda power: f"{THIN}×{THIN}10{str(int(power[1])).translate(_SUPERSCRIPT)}",
        words,
    )
    return re.sub(r"(?<=\s)-(?=\d)", MINUS, powers.replace("+-", "±"))


def level(coverage: float) -> str:
    """Return the nominal coverage of an interval, ``95 %``."""
    return f"{100 * coverage:.3g} %"


def value_and_ends(value: float, low: float, high: float) -> tuple[str, str]:
    """Return ``5.047`` and ``5.043 to 5.051``, with digits by the width of the band."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return significant(value), "–"
    if not high > low:
        return significant(value), f"{significant(low)} to {significant(high)}"
    decimals = min(decimals_for((high - low) / 4), 9)
    return fixed(value, decimals), f"{fixed(low, decimals)} to {fixed(high, decimals)}"


def ranges(numbers: Sequence[int]) -> str:
    """Return ``1 to 4, 7 and 9`` for numbers in rising order."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words: list[str] = []
    for run in runs:
        words += [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
    return listed(words)


def span(values: Array) -> str:
    """Return ``0.98 to 1.02``, or one number where they are alike."""
    low, high = (fixed(float(v), 2) for v in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def listed(words: list[str]) -> str:
    """Return ``a, b and c``."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def residual_label(residual: str) -> str:
    """Return ``LLS MAGNITUDE`` for ``lls_magnitude``."""
    return residual.replace("_", " ").upper()
