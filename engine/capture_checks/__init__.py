"""Looks at each shot while a session is being captured; `checker.Watch` is the one object to feed."""
