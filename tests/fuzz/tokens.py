"""Values that files may hold where others belong."""

from random import Random

_NUMBERS = """
0 -0 1 2 3 -1 -7 0.5 1.5 1e-3 1e-9 1e-300 5e-324 1e9 1e18 1e300 -1e300 1e309 .nan .inf -.inf
NaN Infinity 100000000 4294967296 9223372036854775808 1000000000000000000000000 0100 0o17 0x1F 0x_
0b1 1_000 0.2_0 1:40 190:20:30 +5 .5 5. 1e5 1.e+5 12e03 ١٢ ３ 1,5 1e 2001-01-01 2001-13-45
2001-12-14t21:59:43.10-05:00
"""

NUMBERS = [*_NUMBERS.split(), "7" * 400, "-" + "9" * 400, "1." + "3" * 400]

WORDS = [
    "",
    "text",
    "on",
    "off",
    "yes",
    "no",
    "true",
    "false",
    "null",
    "~",
    "=",
    "<<",
    "drive",
    "name",
    "*",
    "universe",
    "payload",
    "payload.mass",
    "d1.stiffness",
    "shoulder",
    "elbow",
    "arm.urdf",
    "robot.yaml",
    ".",
    "..",
    "/",
    "~root",
    "~nobody_at_all",
    "../../../../../../etc/passwd",
    "/etc/passwd",
    "/dev/zero",
    "/dev/tty",
    "C:\\robots\\arm",
    "file:///etc/passwd",
    "http://127.0.0.1:9/arm.urdf",
    "example-robot-data:",
    "example-robot-data:../../../../../../etc/passwd",
    "package://arm/arm.urdf",
    "a/b",
    "a\\b",
    "a\x00b",
    "a\x1b[31mred\x1b[0m",
    "a\x07\x08\r",
    "a\nb",
    "a\u2028b",
    "a\u202eb",
    "a\u00a0b",
    "\ufeffa",
    "\U0001f916",
    "e\u0301",
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "\"'><b>",
    "&amp;&lt;&#0;",
    "=1+1",
    '=HYPERLINK("http://x","y")',
    "@SUM(A1)",
    "+1",
    "-1",
    "{{ 7 * 7 }}",
    "{% raw %}",
    "{0}",
    "%s%n",
    "$x_1^2$",
    "$\\frac{$",
    "\\alpha",
    "__class__",
    "con",
    "x" * 300,
    "x" * 20_000,
]

RAW = [
    "[]",
    "{}",
    "[[]]",
    "[1, 2]",
    "[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]",
    "[on, off]",
    "{a: 1}",
    "{? [1, 2] : 3}",
    "{[1]: 2}",
    "[1, [2, [3]]]",
    "!!float abc",
    "!!int x",
    "!!str 5",
    "!!binary aGVsbG8=",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!timestamp 2001-13-45",
    "!!python/object/apply:os.system ['true']",
    "!!null x",
    "!unheard x",
    "&a [*a]",
    "*nowhere",
    '"\\ud800"',
    '"\\x00"',
    '"\\e[31m"',
    "'unclosed",
    "[unclosed",
    "{unclosed: ",
    "|\n  block",
    "? x",
    "- x",
    "@x",
    "`x`",
    "%x",
    "#",
    "a: b: c",
    "\tx",
    "[" * 40 + "]" * 40,
    "[" * 1500 + "]" * 1500,
    "{a: " * 1500 + "1" + "}" * 1500,
]
"""YAML as it stands in a file."""


def number(rng: Random) -> str:
    """Return a number, or what looks like one."""
    return rng.choice(NUMBERS)


def word(rng: Random) -> str:
    """Return a text."""
    return rng.choice(WORDS)
