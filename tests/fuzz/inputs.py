"""Bytes that a file from outside may hold: near-valid ones, damaged in ways that occur."""

from __future__ import annotations

import json
from datetime import date

from hypothesis import strategies as st

HEADER = "sample,wavelength_um,quantity,polarization,theta_i_deg,theta_r_deg,value"
_CELLS = st.one_of(
    st.sampled_from(
        ["brdf", "dhr", "s", "p", "u", "3.39", "20", "-10", "0.01", "", "nan", "inf", "-inf", "1e400",
         "0x10", "1_000", "1,5", "=1+1", '"', "\ufeff", "\x00", "\u202e", "9" * 400, "-0.0", "lot"]
    ),
    st.text(max_size=12),
    st.floats(allow_nan=True).map(str),
)  # fmt: skip
_ROWS = st.lists(_CELLS, min_size=5, max_size=9).map(",".join)
_GOOD = st.builds(
    lambda q, a, b, v: f"lot,3.39,brdf,{q},{a},{b},{v}",
    st.sampled_from("spu"), st.integers(0, 89), st.integers(-90, 90),
    st.floats(1e-6, 10.0, allow_nan=False),
)  # fmt: skip
_TEXT = st.builds(
    lambda head, rows, end: end.join([head, *rows]).encode("utf-8", "surrogatepass"),
    st.one_of(st.just(HEADER), st.just(HEADER + ",sigma,scan"), _ROWS),
    st.lists(st.one_of(_GOOD, _ROWS), max_size=12),
    st.sampled_from(["\n", "\r\n", "\r", "\n\n"]),
)
CSV_BYTES = st.one_of(
    _TEXT,
    st.builds(lambda b, at, x: b[: at % (len(b) + 1)] + x + b[at % (len(b) + 1) :],
              _TEXT, st.integers(0, 10**4), st.binary(min_size=1, max_size=8)),
    st.binary(max_size=300),
)  # fmt: skip

_KEYS = st.one_of(
    st.sampled_from(["noise", "tails", "effects", "accuracy", "priors", "holdout", "max_steps",
                     "threads", "brdf_floor", "n", "kind", "mean", "sd", "predict_theta_i_deg"]),
    st.text("abcdefghij_ -.", max_size=10),
)  # fmt: skip
_VALUES = st.recursive(
    st.one_of(
        st.integers(-(10**20), 10**20), st.floats(), st.booleans(), st.dates(),
        st.sampled_from([10**400, -(10**400), 2**63, 1e308, 5e-324]),
        st.sampled_from(["draft", "iid", "auto", "none", "lambert", "normal", "fixed", ""]),
        st.text(max_size=8),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(_KEYS, inner, max_size=3)),
    max_leaves=6,
)  # fmt: skip


def _json(value: object) -> str:
    return json.dumps(value, default=str)


def toml_value(value: object) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


TOML_BYTES = st.one_of(
    st.dictionaries(_KEYS, _VALUES, max_size=4).map(
        lambda t: "\n".join(f"{json.dumps(k)} = {toml_value(v)}" for k, v in t.items()).encode()
    ),
    st.binary(max_size=120),
)


def _toml_like(
    good: dict[str, object], rows: dict[str, dict[str, object]]
) -> st.SearchStrategy[bytes]:
    """A good file, some of its values replaced, keys taken out or added, or its bytes damaged."""
    changes = st.dictionaries(
        st.one_of(st.sampled_from([*good, *(key for row in rows.values() for key in row)]), _KEYS),
        st.one_of(st.none(), _VALUES, _NEAR), max_size=3,
    )  # fmt: skip
    tables = (
        st.lists(st.tuples(st.sampled_from(list(rows)), changes), max_size=3)
        if rows
        else st.just([])
    )

    def text(top: dict[str, object], below: list[tuple[str, dict[str, object]]]) -> str:
        lines = _lines({**good, **top})
        for name, changed in below:
            lines += [f"[[{name}]]", *_lines({**rows[name], **changed})]
        return "\n".join(lines)

    whole = st.builds(text, st.one_of(st.just({}), changes), tables)
    return st.one_of(
        whole.map(lambda t: t.encode("utf-8", "surrogatepass")),
        st.builds(lambda t, at, x: t[: at % (len(t) + 1)].encode("utf-8", "surrogatepass") + x,
                  whole, st.integers(0, 10**4), st.binary(max_size=8)),
    )  # fmt: skip


def _lines(table: dict[str, object]) -> list[str]:
    return [f"{json.dumps(k)} = {toml_value(v)}" for k, v in table.items() if v is not None]


_ANGLES = st.floats(-100, 100) | st.integers(-90, 90)
_NEAR = st.one_of(
    _ANGLES, st.lists(_ANGLES, max_size=4).map(sorted),
    st.builds("{}:{}:{}".format, _ANGLES, _ANGLES, st.sampled_from([0, 1, 1e-300, 1e300, "nan", "inf", -1])),
    st.sampled_from(["n", "brdf", "dhr", "brdf_ratio", "parameter", "s", "u", "simple", "guard", "risk",
                     "2026-03-02", "2026-03-05/2026-03-02", "23\u00a0\u00b0C", "a\nb", "a\u202eb", "\ud800"]),
)  # fmt: skip
LIMITS_BYTES = _toml_like(
    {"specification": "PS-114", "rule": "guard", "guard_factor": 1.6},
    {
        "limit": {"name": "glare", "quantity": "brdf", "polarization": "s", "theta_i_deg": 60,
                  "theta_r_deg": "40:80:2", "phi_r_deg": 0, "upper": 0.5, "lower": 0.0, "guard": 0.01},
        "difference": {"name": "dn", "parameter": "n", "tolerance": 0.1},
    },
)  # fmt: skip
DOCUMENT_BYTES = _toml_like(
    {
        "title": "a",
        "note": "b\nc",
        "date_received": date(2026, 3, 2),
        "date_measured": "2026-03-02",
    },
    {},
)
SCENE_BYTES = _toml_like(
    {"theta_i_deg": [20, 60], "theta_r_deg": "0:80:40", "phi_r_deg": [0, 90], "polarizations": ["s"],
     "dhr_theta_i_deg": 20, "stokes_incident": "u", "phase": "fresnel", "depolarisation": 0.1,
     "instrument": False, "n_draws": 10, "wavelength_um": 3.39, "effects": {"lambert": 0.01}}, {},
)  # fmt: skip
_CANDIDATE = st.builds(
    ",".join,
    st.tuples(
        st.sampled_from(["brdf", "dhr", "ddr", "scan", ""]) | _CELLS, st.sampled_from("spu") | _CELLS,
        st.integers(0, 89).map(str) | _CELLS, *[st.sampled_from(["", "-80", "80", "1", "0"]) | _CELLS] * 3,
        st.sampled_from(["", "5"]) | _CELLS, st.sampled_from(["", "3"]) | _CELLS,
    ),
)  # fmt: skip
CANDIDATES_BYTES = st.builds(
    lambda rows, cut, x: "\n".join([_CANDIDATES_HEADER, *rows]).encode("utf-8", "surrogatepass")[:cut] + x,
    st.lists(_CANDIDATE, max_size=5), st.integers(0, 600), st.just(b"") | st.binary(max_size=4),
)  # fmt: skip
_CANDIDATES_HEADER = "quantity,polarization,theta_i_deg,theta_r_lo_deg,theta_r_hi_deg,theta_r_step_deg,port_deg,minutes"


def _bytes_of(*names: str) -> st.SearchStrategy[tuple[str, float, str, bytes]]:
    return st.tuples(
        st.sampled_from(names), st.floats(0, 1), st.sampled_from(["cut", "write"]),
        st.binary(min_size=1, max_size=8),
    )  # fmt: skip


DAMAGE = st.one_of(
    _bytes_of("summary.json", "config.toml"),
    st.tuples(st.just("summary.json"), st.lists(st.integers(0, 200), min_size=1, max_size=5),
              st.just("value"), st.one_of(st.none(), _VALUES, _NEAR)),
)  # fmt: skip
"""What is done to a run folder: bytes of a file cut off or written over, or a value replaced."""
DAMAGED_DRAWS = _bytes_of("posterior.nc")
_PARAMETERS = st.sampled_from(["n", "k", "sigma_n0", "rho0", "lambert", "nu", "N", "extra"])
PARAMS_TEXT = st.one_of(
    st.dictionaries(_PARAMETERS, _VALUES, max_size=7).map(_json),
    st.builds(
        lambda a, b: _json({"n": 1.5, "k": 0.1, "sigma_n0": 0.4, "rho0": 0.4, a: b}),
        _PARAMETERS, _VALUES,
    ),
    st.text(max_size=60).map(lambda t: "{" + t),
)  # fmt: skip
