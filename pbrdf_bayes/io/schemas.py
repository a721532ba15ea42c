"""A document held against its record, and the JSON schema of a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from pbrdf_bayes.errors import RunFolderError

_ANY_KEY = "[...]"
_MOST = 80


def json_schema(record: type) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a record.

    Parameters
    ----------
    record : type
        One of `pbrdf_bayes.records`.

    Examples
    --------
    >>> from pbrdf_bayes.records.checks import Finding
    >>> json_schema(Finding)["properties"]["size"]
    {'anyOf': [{'type': 'number'}, {'type': 'null'}]}
    """
    schema = msgspec.json.schema(record)
    definitions = schema["$defs"]
    top = definitions.pop(record.__name__)
    found: dict[str, Any] = _without_defaults(top | {"$defs": definitions})
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _without_defaults(schema: Any) -> Any:
    """NaN is the default of many, and no JSON."""
    if isinstance(schema, Mapping):
        kept = {k: v for k, v in schema.items() if k != "default" or isinstance(v, Mapping)}
        return {key: _without_defaults(value) for key, value in kept.items()}
    return [_without_defaults(one) for one in schema] if isinstance(schema, list) else schema


def validate(value: Any, record: type, *, where: str, remedy: str) -> None:
    """Hold plain values against a record.

    Raises
    ------
    RunFolderError
        Path of the first entry that does not fit, its value, what is allowed, and the remedy.
    """
    problem = _problem(value, record)
    if problem is None:
        return
    reason, _, at = problem.rpartition(" - at `$")
    reason, path = (reason, _steps(at)) if reason else (problem, [])
    found = value
    named: list[str] = []
    for step in path:
        key = _guilty(value, named, found, record) if step == _ANY_KEY else step
        named.append(key)
        found = found[int(key) if isinstance(found, list) else key]
    place = "/".join(named) or "top level"
    shown = repr(found) if len(repr(found)) <= _MOST else f"{repr(found)[:_MOST]}..."
    msg = f"{where}: {place}: {reason}{_allowed(record, named, reason)}; it is {shown}. {remedy}"
    raise RunFolderError(msg)


def _problem(value: Any, record: type) -> str | None:
    try:
        msgspec.convert(value, record)
    except msgspec.ValidationError as error:
        return str(error)
    return None


def _steps(path: str) -> list[str]:
    """Keys of a path such as ``.parameters[...].mean[3]`` + a closing quote."""
    text = path.rstrip("`").replace(_ANY_KEY, f".{_ANY_KEY.replace('.', '*')}")
    parts = text.replace("[", ".").replace("]", "").split(".")
    return [_ANY_KEY if part == "***" else part for part in parts if part]


def _guilty(value: Any, path: Sequence[str], mapping: Mapping[str, Any], record: type) -> str:
    """The key of a mapping whose entry alone makes the problem of the whole document."""
    wanted = _problem(value, record)

    def remains(key: str) -> bool:
        return _problem(_replaced(value, path, {key: mapping[key]}), record) == wanted

    return next(key for key in mapping if remains(key))


def _replaced(value: Any, path: Sequence[str], new: Any) -> Any:
    if not path:
        return new
    first, rest = path[0], path[1:]
    if isinstance(value, list):
        return [_replaced(v, rest, new) if i == int(first) else v for i, v in enumerate(value)]
    return {k: _replaced(v, rest, new) if k == first else v for k, v in value.items()}


def _allowed(record: type, path: Sequence[str], reason: str) -> str:
    """The words that an enumeration allows, which `msgspec` leaves out."""
    if "enum" not in reason:
        return ""
    schema: Any = json_schema(record)
    definitions = schema["$defs"]
    for step in path:
        choices = [_followed(s, definitions) for s in schema.get("anyOf", [schema])]
        nodes = [
            s.get("properties", {}).get(step) or s.get("items") or s.get("additionalProperties")
            for s in choices
        ]
        schema = _followed(next((n for n in nodes if n), {}), definitions)
    words = [w for s in schema.get("anyOf", [schema]) for w in s.get("enum", ())]
    return f", allowed: {', '.join(map(str, words))}"


def _followed(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Any:
    name = schema.get("$ref", "").rpartition("/")[2]
    return definitions[name] if name else schema
