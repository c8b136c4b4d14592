"""The verdict of results on disk."""

from collections.abc import Mapping
from pathlib import Path

from engine.pipeline import artifacts
from engine.results.quality import Quality, quality


def quality_of(folders: Mapping[str, Path]) -> Quality | None:
    """The verdict of finished stages, by their folders; None as `quality` says.

    Raises:
        SessionError: a report is damaged.
    """
    reports = {stage: folder / "report.json" for stage, folder in folders.items()}
    facts = {
        stage: artifacts.load_value(report, "values") for stage, report in reports.items() if report.is_file()
    }
    return quality(facts)
