"""Folders of the repository that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MODELS = ROOT / "models"
PUBLISHED = ROOT / "tests" / "published"
