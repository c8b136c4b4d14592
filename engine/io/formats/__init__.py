"""Decoders of single file formats, each of which knows nothing but its format."""
