"""Records of engine/types.py and reports as files: equal records give equal bytes.

A record becomes `<name>.json` (numbers, names, nested reports) and one `<name>.<field>.npy` per array, so
large arrays are memory-mapped when read; a record of arrays in it becomes `<name>.<field>.json` and so on.
Arrays come back read-only. No time stamps anywhere: "identical results" is checked
by hashing these files. JSON has no NaN, so numbers that are not finite are written as the strings "NaN",
"Infinity" and "-Infinity".
"""

import dataclasses
import json
import math
import os
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from engine.errors import SessionError, reason
from engine.io.formats.arrays import UNREADABLE
from engine.io.session import told

Record = TypeVar("Record")


def save(folder: Path, name: str, record: Any) -> None:
    """Write a dataclass of arrays and plain values.

    Raises:
        SessionError: the disk refuses.
    """
    arrays, values, records = {}, {}, []
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if _holds_arrays(value):
            save(folder, f"{name}.{field.name}", value)
            records.append(field.name)
        elif isinstance(value, np.ndarray):
            file = f"{name}.{field.name}.npy"
            _save_array(folder / file, value)
            arrays[field.name] = {"file": file}
        else:
            values[field.name] = plain(value)
    content = {"arrays": arrays, "values": values} | ({"records": records} if records else {})
    save_json(folder / f"{name}.json", content)


def place(folder: Path, array: str, shape: tuple[int, ...]) -> np.ndarray:
    """Room on disk for one array of float32 (`<name>.<field>`) of a record that is larger than memory need be; `save` leaves it there.

    Raises:
        SessionError: the disk has no such room.
    """
    path = folder / f"{array}.npy"
    empty = np.broadcast_to(np.float32(0), shape)
    with told(path), path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(empty))
        # Taken now: a full disk under a mapped file would end the program.
        os.posix_fallocate(file.fileno(), file.tell(), empty.nbytes)
    return np.load(path, mmap_mode="r+")


def _holds_arrays(value: Any) -> bool:
    return dataclasses.is_dataclass(value) and any(
        isinstance(getattr(value, field.name), np.ndarray) for field in dataclasses.fields(value)
    )


def load(folder: Path, name: str, kind: type[Record]) -> Record:
    """Read what `save` wrote.

    Raises:
        SessionError: the files are gone or damaged.
    """
    path = folder / f"{name}.json"
    try:
        content = json.loads(path.read_bytes())
        hints = typing.get_type_hints(kind)
        arrays = {key: _load_array(folder, entry) for key, entry in content["arrays"].items()}
        values = {key: revive(value, hints[key]) for key, value in content["values"].items()}
        records = {key: load(folder, f"{name}.{key}", hints[key]) for key in content.get("records", ())}
        return kind(**arrays, **values, **records)
    except UNREADABLE as error:
        raise _damaged(path, error) from error


def load_value(path: Path, key: str) -> Any:
    """One value of a JSON file that a stage left in its folder.

    Raises:
        SessionError: the file is gone or damaged.
    """
    try:
        return json.loads(path.read_bytes())[key]
    except UNREADABLE as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> SessionError:
    return SessionError(
        f"{path}: cannot be read back ({reason(error)}); remove the folder {path.parent} and process again"
    )


def save_json(path: Path, content: Any) -> None:
    """Canonical enough to hash: sorted keys, fixed layout, synced to disk."""
    with told(path), path.open("w") as file:
        json.dump(content, file, sort_keys=True, indent=1, allow_nan=False)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())


def _save_array(path: Path, array: np.ndarray) -> None:
    if isinstance(array, np.memmap) and array.filename == path.resolve():
        with told(path):
            array.flush()
        return
    stored = np.ascontiguousarray(array)
    with told(path), path.open("wb") as file:
        # numpy's own writer loses the reason when the disk refuses; Python's file keeps it.
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(stored))
        file.write(stored.reshape(-1).view(np.uint8).data)
        file.flush()
        os.fsync(file.fileno())


def _load_array(folder: Path, entry: dict[str, Any]) -> np.ndarray:
    path = folder / entry["file"]
    if "shape" in entry:  # booleans packed to bits, as sessions of 0.1 of November 2026 have them
        shape = entry["shape"]
        bits = np.unpackbits(np.load(path), count=math.prod(shape))
        array = bits.view(bool).reshape(shape)
        array.flags.writeable = False
        return array
    array = np.load(path, allow_pickle=False) if _is_empty(path) else np.load(path, mmap_mode="r")
    array.flags.writeable = False
    # The plain ndarray view keeps the mapping alive and is what compiled kernels know how to take.
    return np.asarray(array).view(np.ndarray)


def _is_empty(path: Path) -> bool:
    """Arrays of no elements cannot be mapped: their file is a header alone."""
    with path.open("rb") as file:
        version = np.lib.format.read_magic(file)
        read = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        return math.prod(read(file)[0]) == 0


def plain(value: Any) -> Any:
    """Dataclasses, tuples and numpy values as what JSON knows."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, Path):
        return str(value)
    return value


def revive(value: Any, hint: Any) -> Any:
    """Undo `plain` as far as the annotation `hint` tells what the value was."""
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None:
            return None
        fits = [arg for arg in args if arg is not type(None)]
        return revive(value, fits[0]) if len(fits) == 1 else value
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = typing.get_type_hints(hint)
        return hint(**{key: revive(item, hints[key]) for key, item in value.items()})
    if hint is float or (hint is Any and value in ("NaN", "Infinity", "-Infinity")):
        return float(value)
    if origin in (tuple, list) or hint in (tuple, list) or _is_sequence(origin):
        inner = _element_hints(args, len(value))
        items = [revive(item, inner[i]) for i, item in enumerate(value)]
        return items if (origin or hint) is list else tuple(items)
    if origin is dict or hint is dict or isinstance(value, dict):
        keys, item_hint = args if len(args) == 2 else (str, Any)
        convert = keys if keys in (int, float) else str
        return {convert(key): revive(item, item_hint) for key, item in value.items()}
    if isinstance(hint, type) and hasattr(hint, "dtype") and isinstance(value, list):
        return np.asarray(revive(value, list[Any]))
    return value


def _is_sequence(origin: Any) -> bool:
    return isinstance(origin, type) and origin.__name__ == "Sequence"


def _element_hints(args: tuple[Any, ...], count: int) -> list[Any]:
    if len(args) == 2 and args[1] is Ellipsis:
        return [args[0]] * count
    if len(args) == count and count > 1:
        return list(args)
    return [args[0] if args else Any] * count
