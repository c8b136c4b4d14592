"""Stage *poses*: where the camera stood, and the lens, from the room behind the object."""
