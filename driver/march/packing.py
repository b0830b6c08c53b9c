"""State of a run, dictionaries of numbers, words, lists and arrays, as bytes and back.

Arrays and JSON are in numpy's npz format.
"""

import io
import json
import zipfile

import numpy as np


class Stack(list):
    """Arrays of one shape that are written as one, without being it: (n, ...)."""


def pack(state: dict, file) -> None:
    """Write the bytes of `state` to `file`, one after the other."""
    arrays = {}
    text = json.dumps(_without_arrays(state, arrays))
    arrays["text"] = np.frombuffer(text.encode(), np.uint8)
    with zipfile.ZipFile(file, "w") as whole:
        for name, array in arrays.items():
            with whole.open(f"{name}.npy", "w", force_zip64=True) as entry:
                _write(entry, array)


def _write(file, array: np.ndarray | Stack) -> None:
    """An array in numpy's format. Raises ValueError for a stack of several shapes."""
    parts, count = (array, (len(array),)) if isinstance(array, Stack) else ([array], ())
    if any(part.shape != parts[0].shape for part in parts):
        raise ValueError("a stack has arrays of one shape")
    kind = np.result_type(*parts)
    np.lib.format.write_array_header_2_0(
        file, {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False,
               "shape": (*count, *parts[0].shape)})
    for part in parts:
        file.write(part.astype(kind, copy=False).tobytes())


def unpacked(content: bytes) -> dict:
    """The state in bytes of `pack`; stacks are arrays.

    Raises OSError, ValueError, LookupError, TypeError or BadZipFile for others.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as kept:
        arrays = {name: kept[name] for name in kept.files}
    return json.loads(arrays["text"].tobytes(),
                      object_hook=lambda entry: _with_array(entry, arrays))


def _without_arrays(value, arrays: dict):
    """`value` with every array in it moved to `arrays` and its name there in its place."""
    if isinstance(value, (np.ndarray, Stack)):
        arrays[f"array{len(arrays)}"] = value
        return {"array": f"array{len(arrays) - 1}"}
    if isinstance(value, dict):
        return {name: _without_arrays(entry, arrays) for name, entry in value.items()}
    return value


def _with_array(entry: dict, arrays: dict):
    """The array whose name `entry` holds, or `entry` itself."""
    return arrays[entry["array"]] if set(entry) == {"array"} else entry
