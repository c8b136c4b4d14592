"""Stage *segment*: where the object is."""
