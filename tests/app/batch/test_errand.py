"""A worker without this program says so and does nothing else."""

import subprocess
import sys

import cloudpickle

from app.batch import errand
from app.sources import program


def test_another_version_is_refused() -> None:
    assert errand.unfit(program()) == ""
    assert "has another version of Roomlight" in errand.unfit("0" * 16)


def test_what_is_sent_needs_no_roomlight_to_say_that_there_is_none() -> None:
    cloudpickle.register_pickle_by_value(errand)
    sent = cloudpickle.dumps(errand.unfit)
    bare = "import pickle, sys; sys.modules['app'] = None; print(pickle.load(sys.stdin.buffer)(''))"
    answer = subprocess.run([sys.executable, "-P", "-c", bare], input=sent, capture_output=True, cwd="/")
    assert b"has no Roomlight that can be used" in answer.stdout, answer.stderr
