"""Looks at each shot while a session is being captured; `checker.ShotChecker` is the one object to feed."""
