"""tools/prose.py: its measures of a small text."""

from __future__ import annotations

import pytest

from tools import prose

TEXT = """# A heading of five words

mor reads `project.yaml`. It *never*
changes a [file](https://example.org/a.b.c), e.g. a table:

* One item of a list
* Another item. It has two sentences!

Run it:

    $ mor adjust project.yaml --snoop

| a table | has no sentences. At all. |
|---|---|

```yaml
mor: 1   # This is code. It does not count.
```
"""


def test_sentences_of_a_text() -> None:
    assert prose.sentences(prose.without_code(TEXT)) == [
        "mor reads code.",
        "It never changes a file, e.g a table:",
        "One item of a list",
        "Another item.",
        "It has two sentences!",
        "Run it:",
    ]


def test_measures() -> None:
    page = prose.measure(TEXT)
    assert page.words == 43
    assert page.mean == pytest.approx(4.0)
    assert prose.faults("page.md", page) == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("word " * 2501, "2501 words"),
        ("word " * 41 + ".", "sentence of 41 words"),
        ("A point is no longer fixed.", "history word 'no longer'"),
        ("The file is said to be wrong.", "private word 'is said to'"),
        ("Two blunders are in it.", "term 'blunder', the glossary has 'gross error'"),
    ],
)
def test_faults(text: str, fault: str) -> None:
    assert any(fault in found for found in prose.faults("page.md", prose.measure(text)))


def test_benchmarks_may_name_machines() -> None:
    page = prose.measure("This ran on a Xeon.")
    assert prose.faults("benchmarks.md", page) == []
    assert prose.faults("page.md", page) == ["page.md: history word 'Xeon'"]


def test_terms_to_use_are_in_the_glossary() -> None:
    glossary = (prose.ROOT / "docs" / "glossary.md").read_text("utf-8")
    english = [line.split("|")[1] for line in glossary.splitlines() if line.startswith("| ")]
    for word, term in prose.OTHER_TERMS.items():
        assert any(term in cell for cell in english), term
        assert not any(word in cell for cell in english), word


def test_all_pages_are_within_the_limits(capsys: pytest.CaptureFixture[str]) -> None:
    assert prose.main() == 0, capsys.readouterr().out
