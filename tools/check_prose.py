"""Hold docstrings, comments, texts and names of the code to the project's rules of prose.

Rules: docs/conventions.md. Usage: python tools/check_prose.py [PATH...]; exit status 1 and one line per finding.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LONGEST_FIRST_LINE = 80
# Words of another century, and words that stand in place of the thing's name; the glossary gives the field's own.
BANNED = (
    "told", "tells", "anew", "had back", "laid", "borne", "wished", "reckon", "made good for", "gone on with",
    "comes of", "whose", "likewise", "thereby", "wherein", "whereupon", "goes on with", "is asked for", "are asked for",
    "as is chosen", "what is", "what are", "what was", "what it is",
)  # fmt: skip
# Glossary: synonym -> the field's term.
SYNONYMS = {
    "product skeleton": "standard skeleton",
    "product's skeleton": "standard skeleton",
    "product's joints": "standard skeleton's joints",
    "own take": "recorded take",
    "sighting": "observation or detection",
    "sightings": "observations or detections",
}
NAMES = {"told", "anew", "laid", "wished", "borne"}  # never a part of an identifier
NOT_VERBS = {
    "a", "an", "the", "this", "that", "these", "those", "what", "who", "whose", "which", "how", "where", "when", "why",
    "whether", "if", "it", "its", "they", "all", "each", "every", "some", "no", "one", "two", "as", "of", "for", "from",
    "in", "on", "at", "by", "to", "with", "without", "after", "before", "only", "also", "true", "false",
}  # fmt: skip
_BANNED = re.compile(r"\b(" + "|".join(map(re.escape, BANNED)) + r")\b", re.IGNORECASE)
_SYNONYMS = re.compile(r"\b(" + "|".join(map(re.escape, SYNONYMS)) + r")\b", re.IGNORECASE)
_RELATIVE = re.compile(r"\b(what|whose|who|which|that which|whatever|whoever)\b", re.IGNORECASE)

Finding = tuple[int, str]


def findings_of(source: str) -> Iterator[Finding]:
    """Yield line number and text of each finding in a module's source."""
    tree = ast.parse(source)
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            docstrings |= {id(part) for part in ast.iter_child_nodes(node.body[0])}
            yield from _first_line(node, node.body[0].lineno, text.split("\n")[0])
            yield from _words(node.body[0].lineno, text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            if " " in node.value:
                yield from _words(node.lineno, node.value)
        elif (name := _defined_name(node)) and (found := NAMES & set(name.lower().split("_"))):
            yield getattr(node, "lineno", 0), f"name {name!r} has {', '.join(found)}: use the glossary's word"
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield from _words(token.start[0], token.string)


def _first_line(node: ast.AST, line: int, text: str) -> Iterator[Finding]:
    """Yield findings in a docstring's first line."""
    if len(text) > LONGEST_FIRST_LINE:
        yield line, f"first line of docstring has {len(text)} characters, {LONGEST_FIRST_LINE} at most: {text}"
    if not text.endswith((".", ":")) and not _is_tooltip(node):
        yield line, f"first line of docstring is no sentence: {text}"
    if found := _RELATIVE.search(text):
        yield line, f"first line of docstring has {found.group(0)!r}: name the thing: {text}"
    if isinstance(node, ast.FunctionDef) and not _is_property(node) and text.split(" ")[0].lower() in NOT_VERBS:
        yield line, f"first line of docstring does not start with a verb: {text}"


def _words(line: int, text: str) -> Iterator[Finding]:
    """Yield banned words and forbidden synonyms."""
    for found in _BANNED.finditer(text):
        yield line + text[: found.start()].count("\n"), f"banned: {found.group(0)!r}"
    for found in _SYNONYMS.finditer(text):
        term = SYNONYMS[found.group(0).lower()]
        yield line + text[: found.start()].count("\n"), f"{found.group(0)!r}: the glossary says {term!r}"


def _is_property(node: ast.FunctionDef) -> bool:
    names = {ast.unparse(decorator).split(".")[-1] for decorator in node.decorator_list}
    return bool(names & {"property", "cached_property", "fixture"})


def _is_tooltip(node: ast.AST) -> bool:
    """Return whether Blender shows a class's docstring as a tooltip, which has no full stop."""
    if not isinstance(node, ast.ClassDef):
        return False
    names = {
        target.id
        for item in node.body
        if isinstance(item, ast.Assign)
        for target in item.targets
        if isinstance(target, ast.Name)
    }
    return bool(names & {"bl_idname", "bl_label"})


def _defined_name(node: ast.AST) -> str:
    """Return the name that a node defines, "" for none."""
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return node.name
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        return node.id
    return node.arg if isinstance(node, ast.arg) else ""


def main(arguments: list[str]) -> int:
    """Print the findings below the paths, the package by default; return 1 if there are any."""
    paths = [Path(path) for path in arguments] or [ROOT / "core", ROOT / "perfanim_addon", ROOT / "tools"]
    files = sorted(file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py")))
    count = 0
    for file in files:
        if file.resolve() == Path(__file__).resolve():
            continue  # it names the words
        for line, text in sorted(findings_of(file.read_text(encoding="utf-8"))):
            sys.stdout.write(f"{file}:{line}: {text}\n")
            count += 1
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
