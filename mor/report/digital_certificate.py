"""The certificate of a camera as XML: PTB's Digital Calibration Certificate (DCC), schema 3.2.0, with D-SI 2.1.0.

The laboratory gives what mor cannot know (:class:`Administration`); mor adds the results with their uncertainties and
covariances. https://ptb.de/dcc/v3.2.0/ describes the elements.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from typing import Annotated, Any, Literal
from xml.etree import ElementTree

import numpy as np
from pydantic import AfterValidator, Field, StringConstraints
from scipy.special import chdtri, fdtri

from mor import __version__
from mor.errors import InputError, Message
from mor.project.document import Document
from mor.project.schema import Strict, validated
from mor.quality.test_statistics import coverage_probability
from mor.report.certificate import Certificate, freedom
from mor.report.language import Words
from mor.report.page import environment, meaning
from mor.types import FloatArray

_PREFIXES = {
    "dcc": "https://ptb.de/dcc",
    "si": "https://ptb.de/si",
    "xsi": "http://www.w3.org/2001/XMLSchema-instance",
}

# ---- What the laboratory says.

Name = Annotated[str, StringConstraints(min_length=1)]


def _country(text: str) -> str:
    if not re.fullmatch("[A-Z]{2}", text):
        raise ValueError(f"found {text!r}, expected two capital letters by ISO 3166-1, such as DE")
    return text


Country = Annotated[str, AfterValidator(_country)]


class Contact(Strict):
    """A laboratory or a customer."""

    name: Name
    city: Name
    country: Country | None = None
    postcode: Name | None = None
    street: Name | None = None
    number: Name | None = None
    email: Name | None = None
    phone: Name | None = None


class Laboratory(Contact):
    """The calibration laboratory."""

    code: Name | None = None
    """Of its accreditation."""


class Person(Strict):
    """A person who is responsible for the certificate."""

    name: Name
    role: Name | None = None
    signs: bool = False
    """True for the main signer."""


class Item(Strict):
    """The camera as an item of calibration."""

    name: Name
    manufacturer: Name
    model: Name | None = None
    serial: Name


class Administration(Strict):
    """Administrative data of a certificate."""

    identifier: Name
    country: Country
    begin: date
    end: date
    place: Literal["laboratory", "customer", "laboratoryBranch", "customerBranch", "other"]
    laboratory: Laboratory
    customer: Contact
    persons: list[Person] = Field(min_length=1)
    item: Item


def administration(document: Document) -> Administration:
    """Return the administrative data. Raises :class:`InputError` that names every key that is missing or wrong."""
    found = validated(document, Administration)
    if found.end < found.begin:
        words = f"end: found {found.end}, expected a date not before begin ({found.begin})"
        raise InputError([Message(words, document.file, document.line(("end",)))])
    return found


# ---- Numbers and units.


def _number(value: float) -> str:
    return repr(float(value))


def _plain(value: float) -> str:
    """A number without an exponent, as factors and probabilities are written."""
    return np.format_float_positional(value, trim="0")


def _power(unit: str) -> tuple[str, int]:
    """Base and exponent of a unit such as ``1/mm^2``."""
    found = re.fullmatch(r"(1/)?([a-z]+)(?:\^(\d+))?", unit)
    if found is None:
        return "", 0
    below, base, exponent = found.groups()
    # Units in D-SI; a number of pixels has the unit one.
    return {"mm": r"\milli\metre", "m": r"\metre", "px": ""}[base], int(exponent or 1) * (-1 if below else 1)


def si_unit(*units: str) -> str:
    """The product of units of mor, such as ``mm`` and ``1/mm^2``, as D-SI writes it."""
    powers: dict[str, int] = {}
    for base, exponent in map(_power, units):
        powers[base] = powers.get(base, 0) + exponent
    parts = [
        base + (f"\\tothe{{{exponent}}}" if exponent != 1 else "")
        for base, exponent in powers.items()
        if base and exponent
    ]
    return "".join(parts) or r"\one"


# ---- The certificate.


def digital_certificate(one: Certificate, admin: Administration, words: Words) -> str:
    """Return the certificate as XML; texts of mor are in the language of ``words``.

    Raises :class:`InputError` for a coverage factor below 1, which the schema does not allow.
    """
    if one.coverage is not None and one.coverage < 1.0:
        raise InputError([Message(f"found {one.coverage:g}, expected 1 or more", "--coverage")])
    camera, factor, nu = one.camera, one.coverage or 2.0, freedom(one.view.summary)
    free = [name for name in camera["correlations"]["components"] if camera["components"][name]["sigma"] is not None]
    p, of_ellipsoid = max(len(free), 1), 0.95  # of the ellipsoid of all components
    square = chdtri(p, 1.0 - of_ellipsoid) if np.isinf(nu) else p * fdtri(p, nu, of_ellipsoid)
    inside = one.table.radius <= one.covered
    radius, shift, U = (column[inside].tolist() for column in (*one.table[:2], factor * one.table.sigma))
    templates = environment()
    templates.filters["number"] = _number
    text = templates.get_template("dcc.xml.j2").render(
        say=words,
        version=__version__,
        admin=admin,
        camera=camera,
        summary=one.view.summary,
        free=free,
        covariance=covariance_of(one, free),
        factor=factor,
        probability=coverage_probability(factor, nu),
        factor_of_ellipsoid=float(np.sqrt(square)),
        probability_of_ellipsoid=of_ellipsoid,
        distribution="normal" if np.isinf(nu) else f"Student t, {nu:.0f} degrees of freedom",
        distortion={"radius": radius, "shift": shift, "uncertainty": U},
        rms=one.rms,
        covered=one.covered,
        unit=one.unit,
        units=one.units,
        meaning=meaning,
        number=_number,
        plain=_plain,
        si_unit=si_unit,
    )
    for prefix, uri in _PREFIXES.items():
        ElementTree.register_namespace(prefix, uri)
    root = ElementTree.fromstring(text)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def covariance_of(one: Certificate, free: Sequence[str]) -> FloatArray | None:
    """Covariance matrix of components, in products of their units; None if the results have no correlations."""
    found: dict[str, Any] = one.camera["correlations"]
    if found["matrix"] is None:
        return None
    chosen = [found["components"].index(name) for name in free]
    sigma = np.array([one.camera["components"][name]["sigma"] for name in free])
    return np.asarray(np.array(found["matrix"])[np.ix_(chosen, chosen)] * np.outer(sigma, sigma))
