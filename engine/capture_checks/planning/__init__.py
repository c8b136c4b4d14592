"""Which directions are covered, and which view helps most next."""
