"""YAML with the number and boolean rules of YAML 1.2, and the line of every key.

PyYAML follows YAML 1.1, where `1e-3` is a text, `on` a boolean and `1:30` a number in base 60: all three are pitfalls
in a robot's configuration. Only its scanner and composer are used; this module interprets plain words.

If PyYAML has libyaml, its scanner and composer are used, which are ten times as fast. Texts that it refuses are read
again by PyYAML's own, which have better error messages. libyaml's composer overflows the stack with deeply nested
texts; for those that may be such, only its scanner is used.
"""

from __future__ import annotations

import contextlib
import re

import yaml
from yaml.composer import Composer

from trocar.procs.config.read.jsontext import Parsed, TextError
from trocar.procs.config.read.problem import KeyPath

_DEEPEST = 64
_OVERFLOWS = 2000  # far below the depth at which libyaml's composer needs a stack of 8 MB
_MAX_NODES = 500_000  # aliases can make a short text explode
_WORD = re.compile(
    r"(?:(?P<null>~|null|Null|NULL|)|(?P<boolean>true|True|TRUE|false|False|FALSE)|(?P<integer>[-+]?[0-9]+)|"
    r"(?P<based>0o[0-7]+|0x[0-9a-fA-F]+)|(?P<number>[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?)|"
    r"(?P<special>[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)))\Z")


class _YamlLoader(yaml.SafeLoader):
    """Distinguishes plain from quoted words, and resolves nothing else."""


_YamlLoader.yaml_implicit_resolvers = {}
_TAGS = {yaml.ScalarNode: _YamlLoader.DEFAULT_SCALAR_TAG, yaml.SequenceNode: _YamlLoader.DEFAULT_SEQUENCE_TAG,
         yaml.MappingNode: _YamlLoader.DEFAULT_MAPPING_TAG}

if yaml.__with_libyaml__:

    class _Quick(yaml.CSafeLoader):
        """The same loader by libyaml."""

        def descend_resolver(self, _parent: object, _index: object) -> None:
            """Nothing depends on where a node is."""

        def ascend_resolver(self) -> None:
            """Nothing depends on where a node is."""

        def resolve(self, kind: type[yaml.Node], _value: object, _implicit: object) -> str:
            """The tag of a node without one."""
            return _TAGS[kind]

    class _QuickAndDeep(Composer, _Quick):
        """The same loader with libyaml's scanner only."""

        def __init__(self, text: str) -> None:
            _Quick.__init__(self, text)
            Composer.__init__(self)


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
            return (_Quick if _deepest(text) < _OVERFLOWS else _QuickAndDeep)(text).get_single_node()
    loader = _YamlLoader(text)
    try:
        return loader.get_single_node()
    finally:
        loader.dispose()


def _deepest(text: str) -> int:
    """An upper bound of the depth: levels have brackets, or begin in other columns (a list: in that of its key)."""
    return text.count("[") + text.count("{") + 2 * max(map(len, text.splitlines()), default=0)


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
                raise _error(name_node, "a key must be a text" + (
                    f", not {name_node.value!r}" if isinstance(name_node, yaml.ScalarNode) else ""))
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
    word = _WORD.match(text)
    kind = word.lastgroup if word else None
    if kind == "null":
        return None
    if kind == "boolean":
        return text[0] in "tT"
    if kind in ("integer", "based") and len(text) < 30:
        return int(text, 10 if kind == "integer" else 0)
    if kind in ("integer", "number"):
        return float(text)
    return float(text.replace(".", "", 1)) if kind == "special" else text


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


def _error(node: yaml.Node, what: str) -> TextError:
    return TextError(_line(node), int(node.start_mark.column) + 1, what)
