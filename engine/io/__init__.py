"""Files: sessions, photographs, meshes, ground truths and maps made elsewhere; everything that knows a format."""
