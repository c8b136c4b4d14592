import pytest

from hardware.errors import SettingsError
from hardware.grbl.config import GrblConfig


def test_a_url_says_everything():
    query = {
        "baud": "250000", "axes": "xy", "pan": "-90..270.5", "tilt": "-10..60", "feed": "1200", "steps": "88.889,100",
        "backlash": "0.3", "homing": "none", "home": "-1,2", "wrap": "yes",
    }  # fmt: skip
    assert GrblConfig.from_query("/dev/x", query) == GrblConfig(
        "/dev/x", 250000, "xy", (-90.0, 270.5), (-10.0, 60.0), 1200.0, (88.889, 100.0), (0.3, 0.3), "none", (-1.0, 2.0),
        True,
    )  # fmt: skip


def test_an_empty_url_is_a_turntable_at_the_usual_baud_rate():
    assert GrblConfig.from_query("/dev/x", {}) == GrblConfig("/dev/x")
    assert GrblConfig.from_query("/dev/x", {"pan": "endless"}).pan is None


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("speed", "3"), ("baud", "fast"), ("baud", "0"), ("axes", "yx"), ("pan", "180"), ("pan", "90..-90"),
        ("pan", "nan..3"), ("pan", "-inf..3"), ("feed", "0"), ("feed", "inf"), ("steps", "1,2,3"), ("steps", "-5"),
        ("backlash", "-1"), ("homing", "yes"), ("home", "nan"), ("wrap", "1"), ("wrap", ""), ("tilt", ".."),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_told_by_its_name(word: str, text: str):
    query = {"axes": "xy", word: text}
    with pytest.raises(SettingsError, match=word):
        GrblConfig.from_query("/dev/x", query)


def test_an_unknown_word_is_told_with_those_there_are():
    with pytest.raises(SettingsError, match=r"'colour'.*backlash, baud"):
        GrblConfig.from_query("/dev/x", {"colour": "red"})
