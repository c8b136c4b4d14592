import pytest

from hardware.camera import quirks
from tests.hardware.camera.canon_r8 import AEB, DRIVES, FORMATS

CHOICES = {"aeb": AEB, "drivemode": DRIVES}
NIKON = (
    "JPEG Basic",
    "JPEG Normal",
    "JPEG Fine",
    "NEF (Raw)",
    "NEF+Basic",
    "NEF+Normal",
    "NEF+Fine",
    "TIFF (RGB)",
)
SONY = ("Standard", "Fine", "Extra Fine", "RAW", "RAW+JPEG")


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        ("Canon EOS R8", quirks.CanonEosR8), ("Canon EOS R5", quirks.CanonEos), ("Canon EOS 5D Mark III", quirks.CanonEos),
        ("Nikon DSC D750", quirks.Nikon), ("Sony Alpha-A7 III", quirks.SonyAlpha), ("Fuji X-T4", quirks.AnyCamera),
    ],
)  # fmt: skip
def test_a_model_is_known_by_its_most_particular_quirks(model, kind):
    assert type(quirks.of(model)) is kind


def test_an_r8_brackets_by_itself_and_its_files_come_middle_first():
    own = quirks.of("Canon EOS R8").own_bracket((-3.0, 0.0, 3.0), CHOICES)
    assert own is not None
    assert own.changes == (("aeb", "+/- 3"), ("drivemode", "Continuous high speed"))
    assert own.order == (0.0, -3.0, 3.0)


@pytest.mark.parametrize(
    "stops", [(0.0,), (0.0, 0.0, 0.0), (-3.0, 0.0, 2.0), (-4.0, 0.0, 4.0), (-3.0, -1.5, 0.0, 1.5, 3.0), (0.0, 3.0, 6.0), ()]
)  # fmt: skip
def test_other_brackets_are_not_its_own(stops):
    assert quirks.of("Canon EOS R8").own_bracket(stops, CHOICES) is None


def test_without_continuous_drive_there_is_no_bracket_at_one_release():
    assert (
        quirks.of("Canon EOS R8").own_bracket((-3.0, 0.0, 3.0), {**CHOICES, "drivemode": ("Single",)}) is None
    )
    assert quirks.of("Canon EOS R8").own_bracket((-3.0, 0.0, 3.0), {"drivemode": DRIVES}) is None


def test_nobody_else_is_trusted_with_a_bracket():
    for model in ("Canon EOS R5", "Nikon DSC D750", "Sony Alpha-A7 III", "Fuji X-T4"):
        assert quirks.of(model).own_bracket((-3.0, 0.0, 3.0), CHOICES) is None


@pytest.mark.parametrize(
    ("choices", "expected"),
    [(FORMATS, "RAW"), (NIKON, "NEF (Raw)"), (SONY, "RAW"), (("cRAW", "RAW + Large Fine JPEG"), "cRAW"),
     (("Large Fine JPEG", "RAW + Large Fine JPEG"), None), ((), None)],
)  # fmt: skip
def test_raw_is_asked_for_without_a_jpeg_beside_it(choices, expected):
    assert quirks.raw_alone(choices) == expected
