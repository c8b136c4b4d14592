"""What holds for every test."""

from hypothesis import settings

from app import cores

# Two processes of tests on two cores, and the programs they start: what is compiled once serves all.
cores.prepare()

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("roomlight", deadline=None)
settings.load_profile("roomlight")
