"""One change that breaks the program: which text of which file becomes what, and which tests should notice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Change:
    """`old` stands exactly once in `file`; `breaks`: what goes wrong then; `tests`: addresses for pytest.

    `survives`: why no test can notice; empty where one must.
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
        """Why the change cannot be made any more; empty where it can."""
        path = root / self.file
        if not path.is_file():
            return f"there is no {self.file}"
        found = path.read_text(encoding="utf-8").count(self.old)
        if found != 1:
            return f"{self.file} has the text {found} times, once is needed: {self.old.strip()!r}"
        missing = [each for each in self.tests if not (root / each.split("::")[0]).exists()]
        return f"there is no {missing[0]}" if missing else ""

    def apply(self, root: Path) -> None:
        """Make the change in a copy. Raises ValueError when it is stale."""
        if why := self.stale(root):
            raise ValueError(why)
        path = root / self.file
        path.write_text(path.read_text(encoding="utf-8").replace(self.old, self.new), encoding="utf-8")
