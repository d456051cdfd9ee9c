"""Change that breaks the program: file, old and new text, and the tests that should notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Change:
    """Seeded fault.

    `old` occurs exactly once in `file`. `breaks` states the resulting fault, `tests` the addresses for pytest.
    `survives` states why no test can notice it; it is empty if a test must notice it.
    """

    file: str
    old: str
    new: str
    breaks: str
    tests: tuple[str, ...]
    survives: str = ""

    @property
    def title(self) -> str:
        """A line for lists."""
        return f"{self.file}: {self.breaks}"

    def stale(self, root: Path = ROOT) -> str:
        """Return why the change can no longer be made, or an empty text if it can."""
        path = root / self.file
        if not path.is_file():
            return f"there is no {self.file}"
        found = path.read_text(encoding="utf-8").count(self.old)
        if found != 1:
            return f"{self.file} has the text {found} times, once is needed: {self.old.strip()!r}"
        missing = [each for each in self.tests if not (root / each.split("::")[0]).exists()]
        return f"there is no {missing[0]}" if missing else ""

    def apply(self, root: Path) -> None:
        """Make the change in a copy.

        Raises
        ------
        ValueError
            The change is stale.
        """
        if why := self.stale(root):
            raise ValueError(why)
        path = root / self.file
        path.write_text(path.read_text(encoding="utf-8").replace(self.old, self.new), encoding="utf-8")
