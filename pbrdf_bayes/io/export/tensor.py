"""The tensor container of Mitsuba, and the ``.pbsdf`` that is one."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes.io.export.records import HalfAngleGrid

_MAGIC, _VERSION, _ALIGNED = b"tensor_file\0", b"\x01\x00", 8
_CODES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "u8": 7, "i8": 8, "f2": 9,
          "f4": 10, "f8": 11}  # fmt: skip


def pbsdf_bytes(grid: HalfAngleGrid) -> bytes:
    """Content of a ``.pbsdf`` file, as the plugin ``measured_polarized`` reads it."""
    return tensor_bytes(
        {
            "theta_h": grid.theta_h.astype("<f4")[None, :],
            "theta_d": grid.theta_d.astype("<f4")[None, :],
            "phi_d": grid.phi_d.astype("<f4")[None, :],
            "wvls": grid.wavelength_nm.astype("<u2"),
            "M": grid.mueller.astype("<f4"),
        }
    )


def tensor_bytes(fields: Mapping[str, NDArray[Any]]) -> bytes:
    """Arrays by name as one file: little endian, C order, data on multiples of 8 bytes.

    Examples
    --------
    >>> tensor_bytes({"a": np.zeros(3, "<f4")})[:14]
    b'tensor_file\x00\x01\x00'
    """
    heads = {
        name: struct.pack("<H", len(name.encode())) + name.encode()
        + struct.pack("<HB", array.ndim, _CODES[array.dtype.str[1:]])
        for name, array in fields.items()
    }  # fmt: skip
    offset = len(_MAGIC) + len(_VERSION) + 4
    offset += sum(len(head) + 8 + 8 * fields[name].ndim for name, head in heads.items())
    content = [_MAGIC, _VERSION, struct.pack("<I", len(fields))]
    data = []
    for name, array in fields.items():
        padding = -offset % _ALIGNED
        offset += padding
        content += [heads[name], struct.pack(f"<Q{array.ndim}Q", offset, *array.shape)]
        data += [b"\0" * padding, np.ascontiguousarray(array).tobytes()]
        offset += array.nbytes
    return b"".join(content + data)
