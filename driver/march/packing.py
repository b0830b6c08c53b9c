"""State of a run, dictionaries of numbers, words, lists and arrays, as bytes and back.

Arrays and JSON are in numpy's npz format.
"""

import io
import json

import numpy as np


def packed(state: dict) -> memoryview:
    """The bytes of `state`."""
    arrays, whole = {}, io.BytesIO()
    text = json.dumps(_without_arrays(state, arrays))
    np.savez(whole, text=np.frombuffer(text.encode(), np.uint8), **arrays)
    return whole.getbuffer()


def unpacked(content: bytes) -> dict:
    """The state in bytes of `packed`.

    Raises OSError, ValueError, LookupError, TypeError or BadZipFile for others.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as kept:
        arrays = {name: kept[name] for name in kept.files}
    return json.loads(arrays["text"].tobytes(),
                      object_hook=lambda entry: _with_array(entry, arrays))


def _without_arrays(value, arrays: dict):
    """`value` with every array in it moved to `arrays` and its name there in its place."""
    if isinstance(value, np.ndarray):
        arrays[f"array{len(arrays)}"] = value
        return {"array": f"array{len(arrays) - 1}"}
    if isinstance(value, dict):
        return {name: _without_arrays(entry, arrays) for name, entry in value.items()}
    return value


def _with_array(entry: dict, arrays: dict):
    """The array whose name `entry` holds, or `entry` itself."""
    return arrays[entry["array"]] if set(entry) == {"array"} else entry
