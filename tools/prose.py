"""Measure the documentation: words per page, lengths of sentences, history words, private words, terms.

Run ``python tools/prose.py`` from the root of the repository. The script prints one line per page and every
fault it finds, and ends with exit code 1 if a limit is exceeded. Code blocks and the output of programs in them are
not counted.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST_WORDS = 45_000
MOST_WORDS_OF_A_PAGE = 2_500
MOST_WORDS_OF_A_SENTENCE = 40
LARGEST_MEAN = 18.0
FIGURES = {"benchmarks.md"}
"""Pages that may name dates, machines and seeds."""
HISTORY = re.compile(
    r"\b(?:no longer|since then|used to be|formerly|previously|was tried|taken back|until now|nowadays"
    r"|seeds?|20[12]\d-\d\d-\d\d|commit [0-9a-f]{7,}|GHz|Xeon|EPYC|Ryzen)\b",
    re.IGNORECASE,
)
PRIVATE = re.compile(
    r"\b(?:what hangs on|lay upon|laid upon|put each|weak turn|workshop|kept out|given up|is told|are told"
    r"|is said to|stands for what|further observations?|as far as|but for|of its own accord)\b",
    re.IGNORECASE,
)
"""Wordings that VOCABULARY.md and STYLE.md replace by the terms of the field."""
OTHER_TERMS = {
    "blunder": "gross error",
    "initial value": "approximate value",
    "starting value": "approximate value",
    "perspective centre": "projection centre",
    "exposure station": "projection centre",
    "inner orientation": "interior orientation",
    "outer orientation": "exterior orientation",
    "mutual orientation": "relative orientation",
    "pass point": "tie point",
    "fiducial point": "control point",
    "partial redundancy": "redundancy number",
    "rank defect": "datum defect",
    "vertical deflection": "deflection of the vertical",
    "geoid undulation": "geoid height",
    "horizontal bearing": "bearing",
}
"""Terms that are not in the glossary, with the term of the glossary for each."""
ABBREVIATIONS = re.compile(r"\b(e\.g|i\.e|cf|vs|approx|no|nos|fig|eq|p|pp|et al|ed|vol)\.", re.IGNORECASE)


@dataclass(frozen=True)
class Page:
    """Measures of one page."""

    words: int
    sentences: list[str]
    history: list[str]
    private: list[str]

    @property
    def mean(self) -> float:
        """Mean number of words of a sentence, 0 for a page without sentences."""
        return sum(map(length, self.sentences)) / len(self.sentences) if self.sentences else 0.0


def length(sentence: str) -> int:
    """Return the number of words of a sentence."""
    return len(re.findall(r"[^\W_][\w'’.-]*", sentence))


def without_code(text: str) -> str:
    """Return a Markdown text without its fenced and indented code blocks."""
    kept: list[str] = []
    listed = False
    for line in re.sub(r"^(```|~~~).*?^\1.*?$", "\n", text, flags=re.M | re.S).splitlines():
        if re.match(r"\s*(?:[*+-]|\d+\.) +", line) and (listed or not line.startswith("    ")):
            listed = True
        elif line.strip() and not line.startswith(" "):
            listed = False
        kept.append("" if line.startswith("    ") and not listed else line)
    return "\n".join(kept)


def sentences(text: str) -> list[str]:
    """Return the sentences of a Markdown text without code blocks; headings, tables and pictures have none.

    A list item or a paragraph ends a sentence. Code in a line counts as one word, a link as its text.
    """
    text = re.sub(r"\$\$.*?\$\$", "formula", text, flags=re.S)
    text = re.sub(r"``?[^`\n]+(?:\n[^`\n]+)?``?", "code", text)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"\$[^$\n]+\$", "formula", text)
    paragraphs: list[list[str]] = [[]]
    for line in text.splitlines():
        item = re.match(r"\s*(?:[*+-]|\d+\.) +", line)
        if not line.strip() or line.startswith(("#", "|", "<")):
            paragraphs.append([])
        elif item:
            paragraphs.append([line[item.end() :]])
        else:
            paragraphs[-1].append(line)
    found = []
    for paragraph in paragraphs:
        whole = re.sub(r"[*_]{1,2}(?=\w)|(?<=[\w.:!?])[*_]{1,2}", "", " ".join(paragraph))
        whole = ABBREVIATIONS.sub(r"\1", whole)
        found += [part.strip() for part in re.split(r"(?<=[.!?:])[\")]?\s+(?=[\"(“„]?[^\W_])", whole)]
    return [sentence for sentence in found if length(sentence) > 1]


def measure(text: str) -> Page:
    """Return the measures of a Markdown text."""
    prose = without_code(text)
    said = sentences(prose)
    whole = "\n".join(said)
    return Page(len(prose.split()), said, HISTORY.findall(whole), PRIVATE.findall(whole))


def faults(name: str, page: Page) -> list[str]:
    """Return what is wrong with a page, one line each."""
    found = []
    if page.words > MOST_WORDS_OF_A_PAGE:
        found.append(f"{name}: {page.words} words, more than {MOST_WORDS_OF_A_PAGE}")
    if page.mean > LARGEST_MEAN:
        found.append(f"{name}: sentences of {page.mean:.1f} words in the mean, more than {LARGEST_MEAN:.0f}")
    found += [
        f"{name}: sentence of {length(sentence)} words: {sentence[:80]}"
        for sentence in page.sentences
        if length(sentence) > MOST_WORDS_OF_A_SENTENCE
    ]
    if name not in FIGURES:
        found += [f"{name}: history word {word!r}" for word in page.history]
    found += [f"{name}: private word {word!r}" for word in page.private]
    said = "\n".join(page.sentences).lower()
    return found + [
        f"{name}: term {word!r}, the glossary has {term!r}"
        for word, term in OTHER_TERMS.items()
        if re.search(rf"\b{word}s?\b", said)
    ]


def main() -> int:
    """Print the measures and faults of all pages; return 1 if there is a fault."""
    docs = ROOT / "docs"
    paths = [ROOT / "README.md", *sorted(docs.rglob("*.md"))]
    pages = {str(p.relative_to(docs if docs in p.parents else ROOT)): measure(p.read_text("utf-8")) for p in paths}
    print("words  mean  longest  page")
    for name, page in sorted(pages.items(), key=lambda entry: -entry[1].words):
        longest = max(map(length, page.sentences), default=0)
        print(f"{page.words:5}  {page.mean:4.1f}  {longest:7}  {name}")
    total = sum(page.words for page in pages.values())
    every = [sentence for page in pages.values() for sentence in page.sentences]
    print(f"{total} words in {len(pages)} pages, {sum(map(length, every)) / len(every):.1f} words a sentence")
    found = [fault for name, page in pages.items() for fault in faults(name, page)]
    if total > MOST_WORDS:
        found.append(f"{total} words in all, more than {MOST_WORDS}")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
