"""The room's light at the object, and what of it the object's shading calibrates."""
