"""Bytes that a file from outside may hold: near-valid ones, damaged in ways that occur."""

from __future__ import annotations

import json

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
        st.integers(-(10**20), 10**20), st.floats(), st.booleans(),
        st.sampled_from(["draft", "iid", "auto", "none", "lambert", "normal", "fixed", ""]),
        st.text(max_size=8),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(_KEYS, inner, max_size=3)),
    max_leaves=6,
)  # fmt: skip


def toml_value(value: object) -> str:
    """A value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


TOML_BYTES = st.one_of(
    st.dictionaries(_KEYS, _VALUES, max_size=4).map(
        lambda t: "\n".join(f"{json.dumps(k)} = {toml_value(v)}" for k, v in t.items()).encode()
    ),
    st.binary(max_size=120),
)
_PARAMETERS = st.sampled_from(["n", "k", "sigma_n0", "rho0", "lambert", "nu", "N", "extra"])
PARAMS_TEXT = st.one_of(
    st.dictionaries(_PARAMETERS, _VALUES, max_size=7).map(json.dumps),
    st.builds(
        lambda a, b: json.dumps({"n": 1.5, "k": 0.1, "sigma_n0": 0.4, "rho0": 0.4, a: b}),
        _PARAMETERS, _VALUES,
    ),
    st.text(max_size=60).map(lambda t: "{" + t),
)  # fmt: skip
