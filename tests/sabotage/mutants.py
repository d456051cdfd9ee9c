"""`python -m tests.sabotage.mutants [--sample 40] [--only WORD] [--jobs 2] [--list]`: small changes that nobody chose.

Every comparison, operator, number, `not`, `and` and statement without a value of a file is changed, one at a time: `<`
becomes `<=`, a call is left out, 0.5 becomes 1.5. The list of `tests.sabotage` holds what somebody thought of; this is
what nobody did. `--sample` draws so many of a file, at random by `--seed`; without it all are tried. Exit code 1 where
fewer than nine in ten are noticed.
"""

from __future__ import annotations

import argparse
import ast
import copy
import random
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from tempfile import TemporaryDirectory

from tests.sabotage.change import ROOT, Change
from tests.sabotage.trial import Copies, Verdict

WANTED = 0.9
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}


@dataclass(frozen=True)
class Target:
    """A file, and the tests that are to notice changes of it."""

    file: str
    tests: tuple[str, ...]


TARGETS = (
    Target("drivers/link.py", ("tests/drivers/test_link.py", "tests/drivers/test_link_edges.py")),
    Target(
        "calib/fit/least_squares.py",
        (
            "tests/calib/test_least_squares_details.py",
            "tests/calib/test_rank_decisions.py",
            "tests/calib/test_ending_of_fit.py",
            "tests/calib/test_visits.py",
            "tests/calib/test_identify.py",
            "tests/calib/test_identify_estimate.py",
            "tests/calib/test_certified.py",
        ),
    ),
    Target(
        "calib/model/observations.py",
        ("tests/calib/test_visits.py", "tests/calib/test_observations.py"),
    ),
    Target(
        "acquisition/record/store.py",
        (
            "tests/acquisition/test_store.py",
            "tests/acquisition/test_store_edges.py",
            "tests/acquisition/test_seal.py",
            "tests/acquisition/test_recorder.py",
            "tests/acquisition/test_record_opened.py",
        ),
    ),
)
_ON_THE_LINE = "a computed number that lies on a threshold to the last digit"
_SMALLER = "a short cut: where it no longer answers, the count below it does, and says the same"
# A mutant by its file and what is changed, where that is found on several lines with the text of its line as well
# -> why the program does the same with it
SAME: dict[tuple[str, str], str] = {
    ("drivers/link.py", "4096 -> 4097"): "how much is taken at once; what is more is taken next",
    ("drivers/link.py", "1 -> 2"): "any number above zero switches the option on",
    ("drivers/link.py", "sock.settimeout(0) -> pass"): "select has said that there is something to read",
    ("drivers/link.py", "left <= 0 -> (left < 0)"): "a clock that is read at the very instant",
    (
        "calib/model/observations.py",
        "0.0 -> 1.0",
    ): "line 44: readings that share nothing are carried along, with a scatter of zero: only slower",
    (
        "calib/fit/least_squares.py",
        "1 -> 2: hat = (self.columns @ self.root).reshape(k, n, -1).transpose(1, 0, 2)",
    ): "-2 for -1: numpy takes any negative number for what is left",
    (
        "calib/fit/least_squares.py",
        "1 -> 2: by_visit = observed.by_visit(columns.T.reshape(-1, *observed.whiten.shape[1:]))",
    ): "-2 for -1: numpy takes any negative number for what is left",
    (
        "calib/fit/least_squares.py",
        "1 -> 2: return by_visit.reshape(len(by_visit), -1).T",
    ): "-2 for -1: numpy takes any negative number for what is left",
    (
        "calib/fit/least_squares.py",
        "1 -> 2: scaled = _back(triangle, _back(triangle, right, 1))",
    ): "the transpose and the conjugate transpose of real numbers",
    (
        "calib/fit/least_squares.py",
        "0.0 -> 1.0: out = int(np.argmax(strain)) if np.max(strain, initial=0.0) > _STRAINED else at",
    ): "the largest of no numbers: 1 is below the threshold as 0 is",
    (
        "calib/fit/least_squares.py",
        "True -> False: for j, share in zip(gone, shares.T, strict=True):",
    ): "both are of the same length",
    (
        "calib/fit/least_squares.py",
        "True -> False: for place, rows in zip(places, freedom.tolist(), strict=True):",
    ): "both are of the same length",
    (
        "calib/fit/least_squares.py",
        "(int(c.pose.max()) + 1) * int(freedom.min()) >= count"
        " -> ((int(c.pose.max()) + 1) * int(freedom.min()) > count)",
    ): _SMALLER,
    (
        "calib/fit/least_squares.py",
        "(int(c.pose.max()) + 1) * int(freedom.min()) -> ((int(c.pose.max()) + 1) / int(freedom.min()))",
    ): _SMALLER,
    ("calib/fit/least_squares.py", "int(c.pose.max()) + 1 -> (int(c.pose.max()) - 1)"): _SMALLER,
    (
        "calib/fit/least_squares.py",
        "scale * usual > _MOVES_NOTHING -> (scale * usual >= _MOVES_NOTHING)",
    ): _ON_THE_LINE,
    (
        "calib/fit/least_squares.py",
        "np.max(strain, initial=0.0) > _STRAINED -> (np.max(strain, initial=0.0) >= _STRAINED)",
    ): _ON_THE_LINE,
    (
        "calib/fit/least_squares.py",
        "weight[heaviest] > 0.05 * weight.max() -> (weight[heaviest] >= 0.05 * weight.max())",
    ): _ON_THE_LINE,
    ("calib/fit/least_squares.py", "weight > _DEPENDENT -> (weight >= _DEPENDENT)"): _ON_THE_LINE,
    (
        "calib/fit/least_squares.py",
        "np.abs(np.diag(before)) >= _DEPENDENT -> (np.abs(np.diag(before)) > _DEPENDENT)",
    ): _ON_THE_LINE,
    ("calib/fit/least_squares.py", "left < _DEPENDENT -> (left <= _DEPENDENT)"): _ON_THE_LINE,
    (
        "calib/fit/least_squares.py",
        "cost_there <= cost * (1.0 + 1e-12) -> (cost_there < cost * (1.0 + 1e-12))",
    ): _ON_THE_LINE,
    ("calib/fit/least_squares.py", "change < small -> (change <= small)"): _ON_THE_LINE,
    ("calib/fit/least_squares.py", "change**2 < 1e-12 * cost -> (change ** 2 <= 1e-12 * cost)"): _ON_THE_LINE,
}


def mutants(target: Target) -> list[Change]:
    """Every small change of a file, in the order of its lines."""
    source = (ROOT / target.file).read_text(encoding="utf-8")
    found = []
    for node, other in _changes(ast.parse(source)):
        old = ast.get_source_segment(source, node)
        assert old is not None
        start = _offset(source, node.lineno, node.col_offset)
        end = start + len(old)
        changed = source[:start] + other + source[end:]
        what = f"{' '.join(old.split())} -> {' '.join(other.split())}"
        breaks = f"line {node.lineno}: {what}"
        if changed != source:
            line = source.splitlines()[node.lineno - 1].strip()
            same = SAME.get((target.file, what)) or SAME.get((target.file, f"{what}: {line}"), "")
            found.append(Change(target.file, source, changed, breaks, target.tests, same))
    return sorted(found, key=lambda each: int(each.breaks.split(":")[0].removeprefix("line ")))


def _changes(tree: ast.Module) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield each replaced node and its new text."""
    for node in _meant(tree):
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARISONS:
            yield node, _with(node, ops=[COMPARISONS[type(node.ops[0])]()])
        elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _of_words(node):
            yield node, _with(node, op=OPERATORS[type(node.op)]())
        elif isinstance(node, ast.BoolOp):
            yield node, _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield node, f"({ast.unparse(node.operand)})"
        elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
            yield node, str(not node.value)
        elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            yield node, repr(node.value + 1)
        elif isinstance(node, ast.Expr | ast.AugAssign | ast.Raise):
            yield node, "pass"


def _meant(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes below that state an action: no words, no types, no decorators."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or _says_nothing(child):
                continue
            yield child
            if not isinstance(child, ast.Raise | ast.JoinedStr):  # the words of an error are not its kind
                yield from _meant(child)


def _says_nothing(node: ast.AST) -> bool:
    """Imports, docstrings and bare names at the head of a file."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant | ast.Yield)
    return isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr)


def _of_words(node: ast.BinOp) -> bool:
    """Return whether words are concatenated.

    Any other operator would end in a TypeError, which is no test of the tests.
    """
    held = [side.value if isinstance(side, ast.Constant) else side for side in (node.left, node.right)]
    return any(isinstance(side, str | bytes | ast.JoinedStr) for side in held)


def _with(node: ast.expr, **fields: object) -> str:
    other = copy.deepcopy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return f"({ast.unparse(other)})"


def _offset(source: str, line: int, column: int) -> int:
    """Return the position of a node in the text; columns of nodes count bytes."""
    lines = source.splitlines(keepends=True)
    before = lines[line - 1].encode()[:column].decode()
    return sum(map(len, lines[: line - 1])) + len(before)


def main() -> int:
    """Try the chosen changes and print survivors and scores; return 0 if every file is good."""
    parser = argparse.ArgumentParser(prog="python -m tests.sabotage.mutants", description=__doc__)
    parser.add_argument("--sample", type=int, default=0, help="number per file, 0 for all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", metavar="WORD", help="files whose name holds this word")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time (%(default)s)")
    parser.add_argument("--list", action="store_true", help="only list them")
    options = parser.parse_args()
    chosen: list[Change] = []
    for target in TARGETS:
        if options.only in target.file:
            every = mutants(target)
            some = random.Random(options.seed).sample(every, min(options.sample or len(every), len(every)))
            chosen += some
            sys.stderr.write(f"{target.file}: {len(some)} of {len(every)}\n")
    if options.list:
        sys.stdout.write("".join(f"{each.title}\n" for each in chosen))
        return 0
    with TemporaryDirectory(prefix="truepose-mutants-") as folder, ThreadPoolExecutor(options.jobs) as pool:
        copies = Copies(folder, options.jobs)
        verdicts = []
        for verdict in pool.map(copies.trial, chosen):
            verdicts.append(verdict)
            if not verdict.good:
                why = f" ({verdict.change.survives})" if verdict.change.survives else ""
                sys.stdout.write(f"{verdict.outcome}: {verdict.change.title}{why}\n")
                sys.stdout.flush()
    good = [_told(target, verdicts) for target in TARGETS if options.only in target.file]
    return 0 if all(good) else 1


def _told(target: Target, verdicts: list[Verdict]) -> bool:
    """Print the score of one file; whether it is good enough. Those that change nothing do not count."""
    own = [each for each in verdicts if each.change.file == target.file]
    counted = [each for each in own if each.good or not each.change.survives]
    killed = sum(each.good for each in own)
    score = killed / len(counted) if counted else 1.0
    same = len(own) - len(counted)
    sys.stdout.write(
        f"{target.file}: {killed} of {len(counted)} noticed, {score:.0%}; {same} change nothing\n"
    )
    return score >= WANTED


if __name__ == "__main__":
    sys.exit(main())
