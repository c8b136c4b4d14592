"""Read NumPy's files (.npy, .npz): what can go wrong with a damaged one, under one name.

Source: NumPy's format 1.0 to 3.0, whose header is a Python literal, inside of ZIP archives for .npz.
"""

import tokenize
import zipfile
import zlib

# RuntimeError: an encrypted archive; NotImplementedError: a compression that Python lacks.
UNREADABLE = (
    OSError, ValueError, KeyError, TypeError, EOFError, SyntaxError, tokenize.TokenError, zipfile.BadZipFile,
    zlib.error, RuntimeError, NotImplementedError, MemoryError, OverflowError,
)  # fmt: skip
