"""Mutations of YAML, JSON and XML files: of their structure, not of their letters."""

import json
import re
from collections.abc import Callable
from random import Random
from typing import Any
from xml.etree import ElementTree

import tokens
import yaml

_MARK = "raw-token-{:03d}"


def yaml_tree(content: bytes, rng: Random) -> bytes:
    """Change keys and values of a YAML file."""
    raw: list[str] = []
    tree = _changed(yaml.safe_load(content), rng, raw, _yaml_token)
    dumper = yaml.SafeDumper if rng.randrange(4) else _Plain
    text = yaml.dump(tree, Dumper=dumper, sort_keys=False, allow_unicode=True, width=10_000)
    return _encoded(_with_raw(text, raw))


def json_tree(content: bytes, rng: Random) -> bytes:
    """Change keys and values of a JSON file."""
    raw: list[str] = []
    text = json.dumps(_changed(json.loads(content), rng, raw, _json_token))
    return _encoded(_with_raw(text, raw, '"'))


class _Plain(yaml.SafeDumper):
    """YAML without anchors and aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _changed(
    tree: Any, rng: Random, raw: list[str], token: Callable[[Random], tuple[Any, bool]]
) -> Any:
    """Return a tree with one to three changes; a mark stands for each raw token."""

    def value() -> Any:
        new, plain = token(rng)
        if plain:
            return new
        raw.append(new)
        return _MARK.format(len(raw) - 1)

    root = [tree]
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        owner, key = rng.choice(_places(root))
        _change(owner, key, rng, value, root)
    return root[0]


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Return all owners and keys of values."""
    if isinstance(tree, dict):
        keys: list[Any] = list(tree)
    elif isinstance(tree, list):
        keys = list(range(len(tree)))
    else:
        return []
    below = [place for key in keys for place in _places(tree[key])]
    return [(tree, key) for key in keys] + below


def _change(owner: Any, key: Any, rng: Random, new: Callable[[], Any], root: list[Any]) -> None:
    """Change one entry."""
    inner, value = owner is not root, owner[key]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    kind = rng.randrange(14)
    if kind < 4 and number:
        owner[key] = _scaled(value, rng)
    elif kind < 6:
        owner[key] = new()
    elif kind == 6 and inner:
        del owner[key]
    elif kind == 7 and isinstance(owner, dict):
        owner[rng.choice([str(key)[:-1], f"{key}s", str(new()), 5, None, True])] = owner.pop(key)
    elif kind == 8:
        other, place = rng.choice(_places(root))
        if not (other is root and inner):
            owner[key], other[place] = other[place], value
    elif kind == 9 and isinstance(owner, list) and inner:
        owner.extend([value] * rng.choice([1, 2, 20]))
    elif kind == 10:
        owner[key] = [value] if rng.randrange(2) else {"a": value}
    elif kind == 11 and isinstance(value, str):
        owner[key] = value + tokens.word(rng)
    elif isinstance(owner, dict) and inner:
        owner[str(new())] = new()
    else:
        owner[key] = new()


def _scaled(value: float, rng: Random) -> float:
    """Return a number that may do as well, for all that a schema knows."""
    if isinstance(value, int):  # a count, which must not cost much more
        return value * rng.choice([-1, 0, 2, 3]) + rng.choice([-1, 0, 1])
    factor = rng.choice([-1.0, 0.0, 0.5, 1.9, 1.0000001, 30.0, 1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12])
    return value * factor


def _yaml_token(rng: Random) -> tuple[Any, bool]:
    kind = rng.randrange(5)
    if kind == 0:
        return tokens.word(rng), True
    if kind == 1:
        return rng.choice(tokens.RAW), False
    return tokens.number(rng), False


def _json_token(rng: Random) -> tuple[Any, bool]:
    kind = rng.randrange(4)
    if kind == 0:
        return tokens.word(rng), True
    if kind == 1:
        return rng.choice([None, True, [], {}, [1], [[1, 2]], {"a": 1}, 0, -1, 1.5, 2**70]), True
    if kind == 2:
        return rng.choice(["[" * 100_000, "[" * 1500 + "]" * 1500, '"\\ud800"', '"\\u0000"']), False
    return tokens.number(rng), False


def _with_raw(text: str, raw: list[str], quote: str = "") -> str:
    for number, token in enumerate(raw):
        text = text.replace(f"{quote}{_MARK.format(number)}{quote}", token)
    return text


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


_XML = ["&x;", "&lt;", "<a/>", "]]>", "<![CDATA[1]]>", "&#0;", "<!-- -- -->", "\x0b", '"', "<", "&"]


def xml_tree(content: bytes, rng: Random) -> bytes:
    """Change elements and attributes of a URDF."""
    root = ElementTree.fromstring(content)
    raw: list[str] = []
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        _change_element(root, rng, raw)
    return _encoded(_with_raw(ElementTree.tostring(root, encoding="unicode"), raw))


def _change_element(root: Any, rng: Random, raw: list[str]) -> None:
    elements = list(root.iter())
    element = rng.choice(elements)
    kind = rng.randrange(10)
    if kind < 5:
        element = rng.choice([e for e in elements if e.attrib] or [root])
        name = rng.choice(sorted(element.attrib) or ["name"])
        element.set(name, _attribute(element.get(name, ""), rng, raw))
    elif kind == 5 and element.attrib:
        name = rng.choice(sorted(element.attrib))
        value = element.attrib.pop(name)
        if rng.randrange(2):
            element.set(rng.choice([f"{name}s", "link", "xyz", "value", "name"]), value)
    elif kind == 6:
        element.tag = rng.choice(
            ["link", "joint", "inertial", "mass", "mimic", "limit", "x", "robot"]
        )
    elif kind == 7 and len(element):
        element.remove(rng.choice(list(element)))
    elif kind == 8 and len(element):
        child = rng.choice(list(element))
        element.append(
            child if rng.randrange(2) else rng.choice([e for e in elements if not len(e)])
        )
    else:
        raw.append(rng.choice([*_XML, tokens.word(rng).replace("\x00", "")]))
        element.text = (element.text or "") + _MARK.format(len(raw) - 1)


def _attribute(value: str, rng: Random, raw: list[str]) -> str:
    """Return another value of an attribute."""
    kind = rng.randrange(5)
    numbers = value.split()
    if kind == 0:
        token = tokens.word(rng)
    elif kind == 1 and len(numbers) > 1:
        numbers[rng.randrange(len(numbers))] = tokens.number(rng)
        token = " ".join(numbers[: rng.choice([len(numbers), len(numbers) - 1])])
    elif kind == 2 and re.fullmatch(r"[-\d.e]+", value):
        token = repr(float(value) * rng.choice([-1, 0, 0.5, 1e3, 1e-9, 1e9, 1e200, 1e-200]))
    elif kind == 3:
        token = value + rng.choice([" ", "\u00a0", "\t", "\n", "0", " 0", "_0", "x", "e5", "\x0b"])
    else:
        token = tokens.number(rng)
    if rng.randrange(8):
        raw.append(token.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;"))
    else:
        raw.append(token + rng.choice(_XML))
    return _MARK.format(len(raw) - 1)
