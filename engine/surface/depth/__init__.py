"""Depth from normals, horizons and shadows."""
