"""XML with line numbers: a plain tree of elements. Documents that declare entities are refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from mor.errors import InputError, Problem


@dataclass
class Element:
    """An element: name without namespace, attributes, children, the text directly inside it, its line."""

    name: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, name: str) -> list[Element]:
        """Children of a name."""
        return [child for child in self.children if child.name == name]


class _EntityError(Exception):
    """An entity declaration was met."""


def parse_xml(content: bytes, file: str) -> Element:
    """Root element of an XML document.

    Raises :class:`InputError` if the document is not well-formed or declares entities.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = True
    stack: list[Element] = []
    roots: list[Element] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        element = Element(name.rpartition(":")[2], attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def end(name: str) -> None:
        stack.pop()

    def text(data: str) -> None:
        stack[-1].text += data

    def entity(*_: object) -> None:
        raise _EntityError

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        words = f"this is not well-formed XML: {expat.errors.messages[error.code]}"
        raise InputError([Problem(words, file, error.lineno)]) from None
    except LookupError as error:
        words = f"this XML is said to be in an encoding that nobody knows ({error})"
        raise InputError([Problem(words, file, 1)]) from None
    except _EntityError:
        words = "entity declarations are not allowed in an input file"
        raise InputError([Problem(words, file, parser.CurrentLineNumber)]) from None
    return roots[0]
