"""Depth from normals."""
