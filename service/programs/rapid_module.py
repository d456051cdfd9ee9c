"""A RAPID module: declarations, assignments, and motions with their tools and work objects.

Only declarations of data and motion instructions are read. Routines, structured statements and everything else
are skipped. Instructions and their arguments are from the maker's reference, as sections of the `MOTIONS`
table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from calib.errors import DataError
from service.programs.syntax import Node, SyntaxUnknown, Token, brackets, lexer, literal, split
from service.programs.text import Lines

tokens_of = lexer("!", '"')

_DATA = ("const", "pers", "var")
_BEGINS = (
    "then",
    "else",
    "do",
    "endif",
    "endwhile",
    "endfor",
    "endtest",
    "endproc",
    "endfunc",
    "endtrap",
    "error",
    "undo",
    "backward",
)
_STRUCTURE = (
    *("if", "elseif", "while", "for", "test", "case", "return"),
    *("local", "task", "endmodule", "raise", "retry", "exit", "goto"),
)
_HEADERS = (
    "proc",
    "func",
    "trap",
    "module",
)  # what names a routine ends with its parameters, not with a semicolon
_OPERATORS = ("and", "or", "xor", "not", "div", "mod")
_MOVED = ("offs", "reltool")  # functions that move a target along
_DEEPEST = 8  # constants named by constants
# Words of a constant of a target, tool or work object; a wobjdata has about 50
_LONGEST_VALUE = 200


class MoveInstruction(NamedTuple):
    """The arguments of an instruction: which are targets, and which is the tool."""

    targets: tuple[int, ...]
    tool: int | None


MOTIONS: dict[str, MoveInstruction] = {
    "moveabsj": MoveInstruction((0,), None),
    **dict.fromkeys(("movej", "movel", "movejdo", "moveldo", "movejao", "movelao"), MoveInstruction((0,), 3)),
    **dict.fromkeys(("movejgo", "movelgo", "movejsync", "movelsync"), MoveInstruction((0,), 3)),
    **dict.fromkeys(("movec", "movecdo", "movecao", "movecgo", "movecsync"), MoveInstruction((0, 1), 4)),
    **dict.fromkeys(("triggl", "triggj"), MoveInstruction((0,), 4)),
    "triggc": MoveInstruction((0, 1), 5),
    **dict.fromkeys(("trigglios", "triggjios"), MoveInstruction((0,), 3)),
    "searchl": MoveInstruction((2,), 4),
    "searchc": MoveInstruction((2, 3), 5),
    **dict.fromkeys(("arcl", "arclstart", "arclend"), MoveInstruction((0,), 5)),
    **dict.fromkeys(("arcc", "arccstart", "arccend"), MoveInstruction((0, 1), 6)),
}


@dataclass(frozen=True)
class Declaration:
    """A declaration such as `CONST robtarget p{2} := ...;`.

    It has the name as written, the type in small letters, and the tokens of the value.
    """

    name: str
    type: str
    at: int
    dimensions: tuple[int, ...]
    value: tuple[Token, ...]


@dataclass(frozen=True)
class TargetUse:
    """One target of one motion: a name, or a literal in place.

    Tool and work object are as the instruction names them. `plain` says that the target itself is used, not one
    displaced by Offs or RelTool. `unknown` is the reason why the argument is neither.
    """

    at: int
    joints: bool
    name: str
    target: Node | None
    tool: str
    work_object: str
    plain: bool = True
    unknown: str = ""


class Module:
    """The parts of a RAPID module that are read.

    Raises
    ------
    DataError
        The text is no module.
    """

    def __init__(self, text: str, file: str) -> None:
        self._text, self._file, self._lines = text, file, Lines(text, file)
        self._tokens = tokens_of(text, self._lines, file)
        words = {token.text.lower() for token in self._tokens if token.kind == "name"}
        if not words & {"module", "proc", "robtarget", "jointtarget"}:
            raise DataError(
                "is not a RAPID module.", do="Give a .mod file as the controller saves it.", file=file, line=1
            )
        self._brackets = brackets(self._tokens)
        self._names_at: set[int] = set()
        self.declarations: dict[str, list[Declaration]] = {}
        self._each(self._declare)
        uses: list[TargetUse] = []
        self._each(lambda i: self._motion(i, uses))
        self.uses = tuple(uses)
        self.instructions, self.foreign = self._others()
        self.assigned = self._assignments()

    def line(self, at: int) -> int:
        """Line number of a position."""
        return self._lines.at(at)

    def constant(self, node: Node, depth: int = 0) -> Node:
        """Return the literal behind a name, or the node itself.

        Raises
        ------
        SyntaxUnknown
            The name has no fixed value.
        """
        if node.kind != "name":
            return node
        found = self.declarations.get(node.text.lower(), [])
        if len(found) != 1 or not found[0].value or found[0].dimensions or depth > _DEEPEST:
            raise SyntaxUnknown(node.start, f"'{node.text}' has no value in this module")
        if node.text.lower() in self.assigned:
            raise SyntaxUnknown(node.start, f"'{node.text}' gets another value while the program runs")
        if len(found[0].value) > _LONGEST_VALUE:
            raise SyntaxUnknown(node.start, f"'{node.text}' is a longer value than any part of a target")
        return self.constant(literal(found[0].value), depth + 1)

    def numbers(self, node: Node, count: int) -> list[float]:
        """Return the `count` numbers of a list.

        Raises
        ------
        SyntaxUnknown
            The list holds anything else.
        """
        values = [self.constant(item) for item in self.items(node, count)]
        for value in values:
            if value.kind != "number":
                raise SyntaxUnknown(node.start, f"'{value.text}' is there where a number is needed")
        return [value.value for value in values]

    def items(self, node: Node, count: int) -> tuple[Node, ...]:
        """Return the `count` parts of a list.

        Raises
        ------
        SyntaxUnknown
            The node is no such list.
        """
        found = self.constant(node)
        if found.kind != "list" or len(found.items) != count:
            raise SyntaxUnknown(node.start, f"a list of {count} values is needed here")
        return found.items

    def _each(self, read: Callable[[int], int]) -> None:
        """Read statement by statement.

        `read` looks at a token, and returns the index at which to continue. The content of a statement is not read
        again, so that the time grows only with the length of the text.
        """
        at = 0
        while at < len(self._tokens):
            at = max(read(at), at + 1)

    def _declare(self, i: int) -> int:
        head = self._tokens[i + 1 : i + 4]
        if self._tokens[i].kind != "name" or self._tokens[i].text.lower() not in _DATA:
            return i
        if len(head) < 3 or head[0].kind != "name" or head[1].kind != "name":
            return i
        at, dimensions = i + 3, ()
        if head[2].text == "{":
            end = self._closing(i + 3)
            sizes = [t.text for t in self._tokens[i + 4 : end] if t.text != ","]
            dimensions = tuple(int(size) if size.isdecimal() and len(size) < 10 else 0 for size in sizes)
            at = end + 1
        begins = self._tokens[at].text if at < len(self._tokens) else ""
        if begins not in (":=", ";"):
            return i  # a parameter of a routine
        value = self._until_semicolon(at + 1) if begins == ":=" else []
        name = head[1].text
        self._names_at.add(head[1].start)
        self.declarations.setdefault(name.lower(), []).append(
            Declaration(name, head[0].text.lower(), head[1].start, dimensions, tuple(value))
        )
        return at + len(value) + 1

    def _motion(self, i: int, uses: list[TargetUse]) -> int:
        token = self._tokens[i]
        motion = MOTIONS.get(token.text.lower()) if token.kind == "name" else None
        follows = self._tokens[i + 1].text if i + 1 < len(self._tokens) else ""
        if motion is None or follows in (":=", "(", ")", ",", ";", ":"):
            return i
        statement = self._until_semicolon(i + 1)
        if any(word.kind == "name" and word.text.lower() in MOTIONS for word in statement):
            raise self._not_ended(i)  # the semicolon is another motion's
        parts = [part for part in split(statement, ",", "\\") if part]
        plain = [part for part in parts if part[0].text != "\\"]
        options = {p[1].text.lower(): p[3:] for p in parts if p[0].text == "\\" and len(p) > 1}
        tool = ""
        if motion.tool is not None:
            tool = _name_of(plain[motion.tool]) if motion.tool < len(plain) else "?"
        work_object = _name_of(options["wobj"]) if "wobj" in options else "wobj0"
        joints = token.text.lower() == "moveabsj"
        uses += [
            self._use(plain[k], joints=joints, tool=tool, work_object=work_object)
            for k in motion.targets
            if k < len(plain)
        ]
        return i + 1 + len(statement)

    def _use(self, part: Sequence[Token], *, joints: bool, tool: str, work_object: str) -> TargetUse:
        at = part[0].start
        try:
            node = literal(part)
            plain = not (node.kind == "call" and node.text.lower() in _MOVED and node.items)
            node = node if plain else node.items[0]
            if node.kind in ("name", "element"):
                return TargetUse(node.start, joints, node.text, None, tool, work_object, plain)
            if node.kind == "list" and plain:
                return TargetUse(at, joints, "", node, tool, work_object)
            raise SyntaxUnknown(
                at, f"'{self._text[node.start : node.end]}' is computed while the program runs"
            )
        except SyntaxUnknown as unknown:
            return TargetUse(at, joints, "", None, tool, work_object, unknown=str(unknown))

    def _others(self) -> tuple[list[tuple[int, str]], dict[str, tuple[int, str]]]:
        """Return the instructions that are no known motions, and the targets that they use.

        Instructions are by position, with their words. Targets are in small letters, with the line and the user.
        """
        targets = {
            name
            for name, found in self.declarations.items()
            if any(each.type in ("robtarget", "jointtarget") for each in found)
        }
        plain = self._names_at | {use.at for use in self.uses}
        instructions: list[tuple[int, str]] = []
        foreign: dict[str, tuple[int, str]] = {}
        head, begins, asks, header, taken, words = None, True, "", 0, "", list[str]()
        for i, token in enumerate(self._tokens):
            word = token.text.lower()
            follows = self._tokens[i + 1].text if i + 1 < len(self._tokens) else ""
            if word in _HEADERS:
                named = next((k for k in range(i + 1, len(self._tokens)) if self._tokens[k].text == "("), i)
                header = self._closing(named) if word not in ("trap", "module") and named > i else i + 1
            elif word == "error" and follows == "(":  # the numbers of errors that are handled
                header = self._closing(i + 1)
            if i <= header or token.text in (";", ":") or word in _BEGINS:
                if head is not None:
                    instructions.append((head.start, " ".join(words)))
                head, begins, asks, taken, words = None, True, "", "", []
                continue
            operand = token.kind == "name" and word not in _OPERATORS
            if asks == "if" and self._ends_value(i - 1) and (operand or word == "%"):
                begins, asks, words = True, "", []  # `IF asked WeldAt p1;`, in which nothing stands between
            words.append("" if token.kind == "string" else token.text)
            part = asks and (
                follows == "." or self._tokens[i - 1].text not in ("(", ",")
            )  # compared, not handed over
            if word in targets and token.start not in plain and taken and not part:
                foreign.setdefault(word, (self.line(token.start), taken))
            if token.text == ":=" and self._sets(i):
                taken = "an assignment"
            if token.text == "\\" and follows.lower() in (
                "tload",
                "corr",
            ):  # of motions that are read as well
                instructions.append((token.start, f"\\{follows}"))
            if begins:
                begins = False
                calls = token.kind == "name" and follows not in (":=", "{", ".", ":", "(")
                asks = word if word in ("if", "elseif", "while", "test", "for", "case") else ""
                instructs = calls and word not in (*_DATA, *_STRUCTURE)
                head = token if instructs and word not in MOTIONS else None
                taken = f"'{token.text}'" if instructs or asks or word in ("return", "%") else ""
        return instructions, foreign

    def _ends_value(self, i: int) -> bool:
        """Return whether a value may end with token `i`.

        A name behind it then begins something new.
        """
        token = self._tokens[i]
        named = token.kind == "name" and token.text.lower() not in ("if", *_OPERATORS)
        return named or token.kind in ("number", "string") or token.text in (")", "]", "}")

    def _sets(self, i: int) -> bool:
        """Return whether the := at token `i` sets data, and no optional argument."""
        return i < 2 or self._tokens[i - 2].text != "\\"

    def _assignments(self) -> dict[str, int]:
        """Map names of data that get a value outside their declaration to the line."""
        out: dict[str, int] = {}
        tokens = self._tokens
        for i, token in enumerate(tokens[:-1]):
            before = tokens[i - 1].text if i else ""
            if token.kind != "name" or before in ("\\", ".") or token.start in self._names_at:
                continue
            j = i + 1
            while j < len(tokens) - 1 and tokens[j].text in (".", "{"):
                j = j + 2 if tokens[j].text == "." else self._closing(j) + 1
            if j < len(tokens) and tokens[j].text == ":=":
                out.setdefault(token.text.lower(), self.line(token.start))
        return out

    def _until_semicolon(self, at: int) -> list[Token]:
        for i in range(at, len(self._tokens)):
            if self._tokens[i].text == ";":
                return self._tokens[at:i]
        raise self._not_ended(at - 1)

    def _not_ended(self, at: int) -> DataError:
        line = self.line(self._tokens[at].start)
        return DataError("a statement is not ended.", do="End it with ';'.", file=self._file, line=line)

    def _closing(self, at: int) -> int:
        if at not in self._brackets:
            line = self.line(self._tokens[at].start)
            raise DataError("a bracket is not closed.", do="Close it.", file=self._file, line=line)
        return self._brackets[at]


def _name_of(part: Sequence[Token]) -> str:
    """Return a plain name, '?' for anything else."""
    return part[0].text if len(part) == 1 and part[0].kind == "name" else "?"
