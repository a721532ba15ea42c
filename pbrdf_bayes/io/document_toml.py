"""The file of the items of a report: TOML in, nothing unknown passes."""

from __future__ import annotations

from datetime import date, datetime
from pathlib import Path
from typing import Any

from pbrdf_bayes.document import Document, check_document_keys
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.config_toml import read_toml


def read_document(path: str | Path) -> Document:
    """Items of a report from a TOML file.

    Parameters
    ----------
    path : str or Path
        Its keys are the fields of `Document`, at the top level or below ``[document]``. Dates may
        be those of TOML.

    Returns
    -------
    Document

    Raises
    ------
    ConfigError
        File missing or not TOML, unknown key, value not allowed; the message names file and key.
    """
    table = read_toml(Path(path))
    if set(table) == {"document"} and isinstance(table["document"], dict):
        table = table["document"]
    try:
        check_document_keys(table)
        return Document(**{key: _text(value) for key, value in table.items()})
    except ConfigError as error:
        msg = f"{path}: {error}"
        raise ConfigError(msg) from None


def _text(value: Any) -> Any:
    """Dates of TOML as text; the rest as it is."""
    if isinstance(value, date) and not isinstance(value, datetime):
        return value.isoformat()
    return value.strip() if isinstance(value, str) else value
