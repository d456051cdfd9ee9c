"""`python -m tests.prose`: passages that break a rule of plain English, by file and line.

Docstrings are counted per package; error messages, the help of commands, the strings of the operator's page and
Markdown apart from them. `--limits` fails if a count is above its limit in `limits.json`; `--write-limits` lowers the
limits to the counts of today. Exit code 1 if a limit is exceeded.
"""

from __future__ import annotations

import argparse
import ast
import collections
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.messages import messages
from tests.prose.words import (
    DISTRIBUTIVE,
    FRAGMENT,
    MUTE,
    MUTE_MODULES,
    NOMINAL,
    OF_CHAIN,
    PRONOUN,
    RAISES,
    WHAT,
    WHERE,
    WORDS,
)

ROOT = Path(__file__).parents[2]
LIMITS = Path(__file__).with_name("limits.json")
MAX_WORDS = 30
MAX_SUMMARY = 90

RULES = {
    "W": "private word or idiom",
    "P01": "docstring starts without a subject or verb",
    "P02": "first line refers to a pronoun that has no antecedent",
    "P03": "attributes or arguments listed in running text",
    "P04": f"summary longer than {MAX_SUMMARY} characters",
    "P05": "exceptions in running text instead of a Raises section",
    "P06": "nominalised verb phrase: 'the refusal of', 'the check that'",
    "S01": f"sentence longer than {MAX_WORDS} words",
    "S02": "chain of three or more 'of'",
    "S03": "what-clause used as a noun",
    "S04": "distributive 'a' instead of 'per'",
    "S05": "sentence with two or more semicolons or colons",
    "S06": "'where' used for 'if' or 'when'",
    "E01": "error message has no 'what to do'",
    "N01": "class name used by several classes of the program",
    "N02": "class name used again in tests or benchmarks",
    "N03": "module or class name that says nothing",
}


class Finding(NamedTuple):
    """One place that breaks a rule: its file, line, rule and the text; `kind` if it is no docstring and no Markdown."""

    file: str
    line: int
    code: str
    text: str
    kind: str = ""

    @property
    def group(self) -> str:
        """What it is counted with: messages, help or page, otherwise its package or folder of documents."""
        parts = self.file.split("/")
        if self.kind:
            return self.kind
        if parts[0] == "docs":
            return "/".join(parts[:2]) if len(parts) > 2 else "docs"
        return parts[0] if len(parts) > 1 else "(root)"


def tracked(*patterns: str) -> list[str]:
    """List the tracked files that match Git path patterns."""
    done = subprocess.run(
        ["git", "ls-files", *patterns], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [name for name in done.stdout.splitlines() if (ROOT / name).is_file()]


def flexible(pattern: str) -> re.Pattern[str]:
    """Compile a word pattern whose spaces match line ends as well."""
    return re.compile(r"(?<![\w-])(?:" + re.sub(r"(?<!\\) ", r"\\s+", pattern) + r")(?![\w-])", re.I)


COMPILED = [(flexible(pattern), pattern, better) for pattern, better in WORDS]
BARE = re.compile(r"``.*?``|`[^`\n]*`|https?://\S+", re.S)


def blank(text: str) -> str:
    """Replace inline code and addresses by one neutral word of equal length and lines."""
    return BARE.sub(lambda m: re.sub(r"[^\n]", "x", m.group()), text)


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Yield the offset and text of each sentence."""
    start = 0
    for match in re.finditer(
        r"(?<![eig]\.[ge])(?<!\b[A-Z])[.!?][)\"']?(?=\s+[A-Z(\"'x]|\s*$)|\n\s*\n|\n(?=\s*(?:[-*]|\d+\.)\s)",
        text,
    ):
        yield start, text[start : match.end()]
        start = match.end()
    if text[start:].strip():
        yield start, text[start:]


def prose(text: str) -> str:
    """Blank out code, tables, section headings and argument names of a docstring, and keep its offsets."""
    lines, kept, section = text.split("\n"), [], False
    for index, line in enumerate(lines):
        below = lines[index + 1] if index + 1 < len(lines) else ""
        heading = bool(re.fullmatch(r"\s*-{3,}\s*", line) or re.fullmatch(r"-{3,}\s*", below))
        section = section or heading
        indented = index > 0 and line.startswith("    ") and not section
        name = section and not line.startswith(" ")
        table = bool(re.search(r"\S {3,}\S", line)) or line.lstrip().startswith((">>>", "|"))
        kept.append(re.sub(r"\S", " ", line) if heading or indented or name or table else line)
    return "\n".join(kept)


def check_text(name: str, line: int, text: str) -> Iterator[Finding]:
    """Check one passage of prose that begins at a line of a file."""
    plain = blank(text)

    def at(offset: int) -> int:
        return line + plain[:offset].count("\n")

    for expression, _, better in COMPILED:
        for match in expression.finditer(plain):
            yield Finding(name, at(match.start()), "W", f"{' '.join(match.group().split())!r}: {better}")
    for code, expression in (("S02", OF_CHAIN), ("S03", WHAT), ("S04", DISTRIBUTIVE), ("S06", WHERE)):
        for match in expression.finditer(plain):
            yield Finding(name, at(match.start()), code, " ".join(match.group().split())[:70])
    for offset, sentence in sentences(plain):
        words = re.findall(r"[A-Za-zÀ-ÿ][\w'’-]*", sentence)
        lead = offset + len(sentence) - len(sentence.lstrip())
        if len(words) > MAX_WORDS:
            yield Finding(name, at(lead), "S01", f"{len(words)} words: {' '.join(sentence.split())[:60]}")
        if len(re.findall(r"[;:](?=\s)", sentence)) >= 2:
            yield Finding(name, at(lead), "S05", " ".join(sentence.split())[:70])


@cache
def nodes(name: str) -> list[ast.AST]:
    """List every node of the syntax tree of a Python file."""
    return list(ast.walk(ast.parse((ROOT / name).read_text("utf-8"))))


def own_names(node: ast.AST) -> set[str]:
    """Name the arguments of a function, or the fields and arguments of a class."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return {a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)} - {
            "self",
            "cls",
        }
    names: set[str] = set()
    for each in getattr(node, "body", []):
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            names.add(each.target.id)
        elif isinstance(each, ast.FunctionDef) and each.name == "__init__":
            names |= own_names(each)
    return names


def check_docstring(name: str, node: ast.AST, text: str, line: int) -> Iterator[Finding]:
    """Check the form of one docstring: summary, sections, sentences."""
    first = text.strip().split("\n\n")[0]
    summary = next(sentences(first), (0, first))[1].strip()
    is_property = any(
        getattr(d, "id", getattr(d, "attr", "")) in ("property", "cached_property", "overload")
        for d in getattr(node, "decorator_list", [])
    )
    if FRAGMENT.match(summary) and not (summary.startswith("Whether") and is_property):
        yield Finding(name, line, "P01", summary[:80])
    if not isinstance(node, ast.Module) and PRONOUN.search(summary) and len(summary.split()) <= 6:
        yield Finding(name, line, "P02", summary[:80])
    if NOMINAL.match(summary):
        yield Finding(name, line, "P06", summary[:80])
    has_sections = bool(re.search(r"^\s*-{4,}\s*$", text, re.M))
    if not has_sections and not isinstance(node, ast.Module):
        listed = {n for n in own_names(node) if re.search(rf"`?\b{n}\b`?(?: \([^)]{{1,20}}\))?:\s", text)}
        if listed:
            yield Finding(name, line, "P03", ", ".join(sorted(listed)))
        if match := RAISES.search(text):
            yield Finding(name, line, "P05", match.group())
    if len(summary) > MAX_SUMMARY:
        yield Finding(name, line, "P04", f"{len(summary)} characters: {' '.join(summary.split())[:50]}")
    yield from check_text(name, line, prose(text))


def literal(node: ast.AST) -> str | None:
    """Return the text of a string or f-string, its fields as `{}`."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
    return None


def check_python(name: str) -> Iterator[Finding]:
    """Check docstrings and help of one Python file, and errors raised without a remedy."""
    for node in nodes(name):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node, clean=True)
            if text:
                kind = (
                    "help"
                    if name.startswith("service/commands/") and getattr(node, "name", "").endswith("_command")
                    else ""
                )
                for finding in check_docstring(name, node, text, node.body[0].lineno):
                    yield finding._replace(kind=kind)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            called = node.exc.func
            error = getattr(called, "id", getattr(called, "attr", ""))
            given = [*node.exc.args, *(k.value for k in node.exc.keywords)]
            texts = [text for each in given if (text := literal(each)) and " " in text]
            remedies = [
                k for k in node.exc.keywords if k.arg in ("do", "what_to_do") and literal(k.value) != ""
            ]
            alone = len(texts) == 1 and len(node.exc.args) < 2 and not remedies
            if (
                error in ("DataError", "ConfigError")
                and alone
                and texts[0].count(".") < 2
                and ";" not in texts[0]
            ):
                yield Finding(name, node.lineno, "E01", texts[0][:80], "messages")
        if isinstance(node, ast.keyword) and node.arg in ("help", "description", "summary", "epilog"):
            for finding in check_text(name, node.value.lineno, literal(node.value) or ""):
                yield finding._replace(kind="help")


def check_messages() -> Iterator[Finding]:
    """Check what errors report, as `python -m tests.messages` lists it."""
    for each in messages():
        for finding in check_text(each.file, each.line, re.sub(r"\{.*?\}", "x", each.text)):
            yield finding._replace(kind="messages")


def check_markdown(name: str) -> Iterator[Finding]:
    """Check the prose of one Markdown file: no code, tables or headings' markup."""
    lines, fenced = [], False
    for text in (ROOT / name).read_text("utf-8").split("\n"):
        if text.lstrip().startswith("```"):
            fenced = not fenced
            lines.append("")
        elif fenced or text.lstrip().startswith(("|", "<", "![")):
            lines.append("")
        else:
            text = re.sub(r"\]\([^)]*\)", lambda m: "]" + " " * (len(m.group()) - 1), text)
            lines.append(text)
    start, block = 0, []
    for index, text in enumerate([*lines, ""]):
        heading = text.startswith("#")
        if text.strip() and not heading:
            if not block:
                start = index
            block.append(text)
        else:
            if block:
                yield from check_text(name, start + 1, "\n".join(block))
            block = []
            if heading:
                yield from check_text(name, index + 1, text.lstrip("# "))


STRING = re.compile(r"\"((?:[^\"\\\n]|\\.){12,})\"")


def check_page(name: str) -> Iterator[Finding]:
    """Check the sentences of one file of the operator's page."""
    for number, line in enumerate((ROOT / name).read_text("utf-8").splitlines(), 1):
        for match in STRING.finditer(line):
            for finding in check_text(name, number, match.group(1)):
                yield finding._replace(kind="page")


def check_names(names: list[str]) -> Iterator[Finding]:
    """Report class names that several classes share, and mute class and module names."""
    places: dict[str, list[tuple[str, int]]] = collections.defaultdict(list)
    for name in names:
        stem = Path(name).stem
        if stem in MUTE_MODULES or (stem == "__init__" and Path(name).parent.name in MUTE_MODULES):
            yield Finding(name, 1, "N03", f"module {stem}")
        for node in nodes(name):
            if isinstance(node, ast.ClassDef):
                places[node.name].append((name, node.lineno))
                if node.name.lstrip("_") in MUTE:
                    yield Finding(name, node.lineno, "N03", f"class {node.name}")
    for name, found in places.items():
        program = [p for p in found if not p[0].startswith(("tests/", "examples/"))]
        if len(program) > 1:
            for file, line in program:
                yield Finding(file, line, "N01", f"class {name}, {len(program)} times")
        if len(found) > 1:
            for file, line in found:
                if file.startswith(("tests/", "examples/")):
                    yield Finding(file, line, "N02", f"class {name}, {len(found)} times")


def collect() -> list[Finding]:
    """Run every check on the tracked files."""
    python = tracked("*.py")
    found = [*check_messages(), *check_names(python)]
    for name in python:
        found.extend(check_python(name))
    for name in tracked("*.md"):
        if not name.startswith("docs/made/"):  # made from texts that are counted where they are written
            found.extend(check_markdown(name))
    found.extend(check_page("service/static/words.js"))
    return found


def print_summary(found: list[Finding]) -> dict[str, dict[str, int]]:
    """Print the counts by package and rule; return them."""
    counts: dict[str, dict[str, int]] = collections.defaultdict(collections.Counter)
    for finding in found:
        counts[finding.group][finding.code] += 1
    codes = [code for code in RULES if any(code in row for row in counts.values())]
    print(f"{'package':<16}" + "".join(f"{code:>6}" for code in codes) + f"{'all':>8}")
    for package in sorted(counts):
        row = counts[package]
        print(
            f"{package:<16}"
            + "".join(f"{row.get(code, 0) or '':>6}" for code in codes)
            + f"{sum(row.values()):>8}"
        )
    total = collections.Counter(f.code for f in found)
    print(f"{'total':<16}" + "".join(f"{total[code]:>6}" for code in codes) + f"{len(found):>8}\n")
    for code in codes:
        print(f"{code:>4}  {RULES[code]}")
    return {package: dict(sorted(row.items())) for package, row in sorted(counts.items())}


def main() -> int:
    """Print the findings, or compare their counts with the limits."""
    parser = argparse.ArgumentParser(prog="python -m tests.prose", description=__doc__)
    parser.add_argument("--summary", action="store_true", help="print the counts only")
    parser.add_argument("--select", default="", help="rules to report, separated by commas (W,S01)")
    parser.add_argument("--groups", default="", help="groups to report, separated by commas (calib,help)")
    parser.add_argument("--limits", action="store_true", help="fail if a count exceeds its limit")
    parser.add_argument("--write-limits", action="store_true", help="keep today's counts as limits")
    asked = parser.parse_args()
    found = collect()
    if asked.limits:
        limits = json.loads(LIMITS.read_text("utf-8"))
        counts = collections.Counter((f.group, f.code) for f in found)
        worse = {key: n for key, n in sorted(counts.items()) if n > limits.get(key[0], {}).get(key[1], 0)}
        for (group, code), n in worse.items():
            print(f"{group}: {code} {n} times, limit {limits.get(group, {}).get(code, 0)}: {RULES[code]}")
        if worse:
            print("List them: python -m tests.prose --groups GROUP --select CODE")
        return 1 if worse else 0
    found = [
        f
        for f in found
        if (not asked.select or f.code in asked.select.split(","))
        and (not asked.groups or f.group in asked.groups.split(","))
    ]
    if not asked.summary and not asked.write_limits:
        for finding in sorted(found):
            print(f"{finding.file}:{finding.line}: {finding.code} {finding.text}")
        print()
    counts = print_summary(found)
    if asked.write_limits:
        LIMITS.write_text(json.dumps(counts, indent=1) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
