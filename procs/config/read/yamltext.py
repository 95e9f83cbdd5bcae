"""YAML with the number and boolean rules of YAML 1.2, and the line of every key.

PyYAML follows YAML 1.1, where `1e-3` is a text, `on` a boolean and `1:30` a number in base 60: all three are pitfalls
in a robot's configuration. Only its scanner and composer are used; this module interprets plain words.

If PyYAML has libyaml, its scanner is used, which is ten times as fast. Texts that it refuses are read again by PyYAML's
own scanner, which has better error messages. The composer is always PyYAML's own: libyaml's overflows the stack with
deeply nested texts.
"""

from __future__ import annotations

import contextlib
import re

import yaml
from yaml.composer import Composer

from trocar.procs.config.read.jsontext import Parsed, TextError
from trocar.procs.config.read.problem import KeyPath

_DEEPEST = 64
_MAX_NODES = 500_000  # aliases can make a short text explode
_NULL = re.compile(r"(?:~|null|Null|NULL|)\Z")
_BOOLEAN = re.compile(r"(?:true|True|TRUE|false|False|FALSE)\Z")
_INTEGER = re.compile(r"[-+]?[0-9]+\Z")
_BASED = re.compile(r"0o[0-7]+\Z|0x[0-9a-fA-F]+\Z")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z")
_SPECIAL = re.compile(r"[-+]?\.(?:inf|Inf|INF)\Z|\.(?:nan|NaN|NAN)\Z")


class _YamlLoader(yaml.SafeLoader):
    """Distinguishes plain from quoted words, and resolves nothing else."""


_YamlLoader.yaml_implicit_resolvers = {}

if yaml.__with_libyaml__:

    class _Quick(Composer, yaml.CSafeLoader):
        """The same loader with libyaml's scanner."""

        def __init__(self, text: str) -> None:
            yaml.CSafeLoader.__init__(self, text)
            Composer.__init__(self)

    _Quick.yaml_implicit_resolvers = {}


def parse_yaml(text: str) -> Parsed:
    """Decode one YAML document; TextError has the position of an error."""
    try:
        node = _compose(text)
    except yaml.MarkedYAMLError as bad:
        mark = bad.problem_mark or bad.context_mark
        what = " ".join(part for part in (bad.context, bad.problem) if part)
        raise TextError(mark.line + 1 if mark else 1, mark.column + 1 if mark else 1, what) from bad
    except yaml.reader.ReaderError as bad:
        before = text[: bad.position]
        column = bad.position - (before.rfind("\n") + 1) + 1
        raise TextError(before.count("\n") + 1, column, f"character #x{bad.character:04x}: {bad.reason}") from bad
    except RecursionError as bad:
        raise TextError(1, 1, "nested too deeply") from bad
    reader = _YamlReader()
    reader.parsed.lines[()] = 1 if node is None else _line(node)
    if node is not None:
        reader.parsed.data = reader.value(node, ())
    return reader.parsed


def _compose(text: str) -> yaml.Node | None:
    if yaml.__with_libyaml__:
        with contextlib.suppress(yaml.YAMLError, UnicodeEncodeError):
            return _Quick(text).get_single_node()
    loader = _YamlLoader(text)
    try:
        return loader.get_single_node()
    finally:
        loader.dispose()


class _YamlReader:
    def __init__(self) -> None:
        self.parsed = Parsed()
        self.nodes = 0

    def value(self, node: yaml.Node, key: KeyPath) -> object:
        self.nodes += 1
        if self.nodes > _MAX_NODES or len(key) > _DEEPEST:
            raise _error(node, "nested too deeply, or an alias that contains itself")
        if isinstance(node, yaml.MappingNode):
            return self.mapping(node, key)
        if isinstance(node, yaml.SequenceNode):
            items = []
            for index, item in enumerate(node.value):
                self.parsed.lines[(*key, index)] = _line(item)
                items.append(self.value(item, (*key, index)))
            return items
        if isinstance(node, yaml.ScalarNode):
            return _scalar(node)
        raise _error(node, "neither a text, a list nor a mapping")

    def mapping(self, node: yaml.MappingNode, key: KeyPath) -> dict[str, object]:
        result: dict[str, object] = {}
        for name_node, item in node.value:
            name = _name(name_node)
            if name is None:
                raise _error(name_node, f"a key must be a text, not {getattr(name_node, 'value', '?')!r}")
            here = (*key, name)
            if name in result:
                raise _error(name_node, f"key {name!r} occurs twice, first in line {self.parsed.lines[here]}")
            self.parsed.lines[here] = _line(name_node)
            result[name] = self.value(item, here)
        return result


def _name(node: yaml.Node) -> str | None:
    """A key: a text, or a number such as a board id, as text; None for anything else."""
    if not isinstance(node, yaml.ScalarNode):
        return None
    name = _scalar(node)
    return str(node.value) if type(name) is int else name if isinstance(name, str) else None


def _scalar(node: yaml.ScalarNode) -> object:
    text = str(node.value)
    if node.tag != "tag:yaml.org,2002:str":
        raise _error(node, f"tag {node.tag} is not used here")
    if node.style:  # quoted or block text
        return text
    if _NULL.match(text):
        return None
    if _BOOLEAN.match(text):
        return text[0] in "tT"
    if len(text) < 30 and _INTEGER.match(text):
        return int(text)
    if len(text) < 30 and _BASED.match(text):
        return int(text, 0)
    if _FLOAT.match(text):
        return float(text)
    if _SPECIAL.match(text):
        return float(text.replace(".", "", 1))
    return text


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


def _error(node: yaml.Node, what: str) -> TextError:
    return TextError(_line(node), int(node.start_mark.column) + 1, what)
