"""What the object hides of the room and of itself."""
