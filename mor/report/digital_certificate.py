"""The certificate of a camera as XML: PTB's Digital Calibration Certificate (DCC), schema 3.2.0, with D-SI 2.1.0.

The laboratory gives what mor cannot know (:class:`Administration`); mor adds the results with their uncertainties and
covariances. https://ptb.de/dcc/v3.2.0/ describes the elements.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import date
from typing import Annotated, Any, Literal
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

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
from mor.report.page import meaning
from mor.types import FloatArray

SCHEMA = "3.2.0"
_DCC, _SI = "https://ptb.de/dcc", "https://ptb.de/si"
_PREFIXES = {"dcc": _DCC, "si": _SI, "xsi": "http://www.w3.org/2001/XMLSchema-instance"}

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


# ---- Elements.


def _add(parent: Element, name: str, text: object = None, **attributes: str) -> Element:
    """Add an element such as ``dcc:item``; nothing is added for an empty text."""
    prefix, _, local = name.partition(":")
    found = SubElement(parent, f"{{{_PREFIXES[prefix]}}}{local}", attributes)
    found.text = None if text is None else str(text)
    return found


def _given(parent: Element, pairs: Iterable[tuple[str, object]]) -> None:
    for name, text in pairs:
        if text is not None:
            _add(parent, name, text)


def _text(parent: Element, name: str, text: str, language: str = "") -> Element:
    found = _add(parent, name)
    _add(found, "dcc:content", text, **({"lang": language} if language else {}))
    return found


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
    one = one._replace(coverage=one.coverage or 2.0)
    for prefix, uri in _PREFIXES.items():
        ElementTree.register_namespace(prefix, uri)
    root = Element(
        f"{{{_DCC}}}digitalCalibrationCertificate",
        {"schemaVersion": SCHEMA, f"{{{_PREFIXES['xsi']}}}schemaLocation": f"{_DCC} {_DCC}/v{SCHEMA}/dcc.xsd"},
    )
    _administrative(_add(root, "dcc:administrativeData"), admin, words.language)
    _results(_add(_add(root, "dcc:measurementResults"), "dcc:measurementResult"), one, words)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _software(parent: Element, name: str) -> None:
    software = _add(_add(parent, name), "dcc:software")
    _text(software, "dcc:name", "mor")
    _add(software, "dcc:release", __version__)


def _administrative(parent: Element, admin: Administration, language: str) -> None:
    _software(parent, "dcc:dccSoftware")
    core = _add(parent, "dcc:coreData")
    _given(
        core,
        [
            ("dcc:countryCodeISO3166_1", admin.country),
            ("dcc:usedLangCodeISO639_1", language),
            ("dcc:mandatoryLangCodeISO639_1", language),
            ("dcc:uniqueIdentifier", admin.identifier),
            ("dcc:beginPerformanceDate", admin.begin),
            ("dcc:endPerformanceDate", admin.end),
            ("dcc:performanceLocation", admin.place),
        ],
    )
    item = _add(_add(parent, "dcc:items"), "dcc:item")
    _text(item, "dcc:name", admin.item.name)
    _text(_add(item, "dcc:manufacturer"), "dcc:name", admin.item.manufacturer)
    _given(item, [("dcc:model", admin.item.model)])
    identification = _add(_add(item, "dcc:identifications"), "dcc:identification")
    _given(identification, [("dcc:issuer", "manufacturer"), ("dcc:value", admin.item.serial)])
    laboratory = _add(parent, "dcc:calibrationLaboratory")
    _given(laboratory, [("dcc:calibrationLaboratoryCode", admin.laboratory.code)])
    _contact(_add(laboratory, "dcc:contact"), admin.laboratory)
    persons = _add(parent, "dcc:respPersons")
    for person in admin.persons:
        responsible = _add(persons, "dcc:respPerson")
        _text(_add(responsible, "dcc:person"), "dcc:name", person.name)
        _given(responsible, [("dcc:role", person.role), ("dcc:mainSigner", "true" if person.signs else None)])
    _contact(_add(parent, "dcc:customer"), admin.customer)


def _contact(parent: Element, contact: Contact) -> None:
    _text(parent, "dcc:name", contact.name)
    _given(parent, [("dcc:eMail", contact.email), ("dcc:phone", contact.phone)])
    _given(
        _add(parent, "dcc:location"),
        [
            ("dcc:city", contact.city),
            ("dcc:countryCode", contact.country),
            ("dcc:postCode", contact.postcode),
            ("dcc:street", contact.street),
            ("dcc:streetNo", contact.number),
        ],
    )


def _results(parent: Element, one: Certificate, words: Words) -> None:
    language, camera = words.language, one.camera
    _text(parent, "dcc:name", words("Calibration of camera {id}", id=camera["id"]), language)
    methods = _add(parent, "dcc:usedMethods")
    adjustment = _add(methods, "dcc:usedMethod")
    _text(adjustment, "dcc:name", words("bundle adjustment by least squares"), language)
    model = words("{id}, model {model}", id=camera["id"], model=camera["model"])
    _text(adjustment, "dcc:description", f"{words('camera')}: {model}", language)
    uncertainty = _add(methods, "dcc:usedMethod")
    _text(uncertainty, "dcc:name", words("expanded uncertainty"), language)
    _add(uncertainty, "dcc:norm", "JCGM 100:2008")
    _software(parent, "dcc:usedSoftware")
    results = _add(parent, "dcc:results")
    data = _result(results, words("interior orientation"), language)
    rows = camera["components"]
    free = [name for name in camera["correlations"]["components"] if rows[name]["sigma"] is not None]
    if free:
        _parameters(_quantity(data, words("Parameters"), language), one, free, words)
    for name in (name for name in rows if name not in free):
        status = words.listed(rows[name]["status"])
        quantity = _quantity(data, f"{name}: {words(meaning('', name))} ({status})", language)
        _real(quantity, rows[name]["value"], one.units[name], name)
    if camera["r0"] is not None:
        _real(_quantity(data, "r0", language), camera["r0"], one.unit)
    _distortion(_add(_result(results, words("Radial distortion"), language), "dcc:list"), one, words)
    data = _result(results, words("Adjustment"), language)
    _real(_quantity(data, words("rms v"), language), one.rms, one.unit)
    ratio = one.view.summary["sigma0"]["ratio_of_sigmas"]
    if ratio is not None:
        _real(_quantity(data, words("sigma0 a posteriori / a priori"), language), ratio, "1")
    verdict = words("accepted") if one.view.summary["global_test"]["accepted"] else words("rejected")
    _text(data, "dcc:text", f"{words('global test')}: {verdict}", language)
    _real(_quantity(data, words("redundancy"), language), one.view.summary["redundancy"], "1")
    valid = _add(_add(parent, "dcc:measurementMetaData"), "dcc:metaData", refType="basic_validityRange")
    said = words("Points were measured up to this distance from the principal point.")
    _text(valid, "dcc:declaration", said, language)
    _real(_quantity(_add(valid, "dcc:data"), words("valid"), language), one.covered, one.unit)


def _result(parent: Element, name: str, language: str) -> Element:
    result = _add(parent, "dcc:result")
    _text(result, "dcc:name", name, language)
    return _add(result, "dcc:data")


def _quantity(parent: Element, name: str, language: str) -> Element:
    found = _add(parent, "dcc:quantity")
    _text(found, "dcc:name", name, language)
    return found


def _real(parent: Element, value: float, unit: str, label: str | None = None) -> Element:
    real = _add(parent, "si:real")
    _given(real, [("si:label", label), ("si:value", _number(value)), ("si:unit", si_unit(unit))])
    return real


def _coverage(parent: Element, factor: float, probability: float, nu: float) -> None:
    name = "normal" if np.isinf(nu) else f"Student t, {nu:.0f} degrees of freedom"
    pairs = [("si:coverageFactor", _plain(factor)), ("si:coverageProbability", _plain(probability))]
    _given(parent, [*pairs, ("si:distribution", name)])


def _parameters(parent: Element, one: Certificate, free: Sequence[str], words: Words) -> None:
    rows, factor, nu = one.camera["components"], one.coverage or 2.0, freedom(one.view.summary)
    found = _add(_add(parent, "si:list"), "si:realList")
    for name in free:
        real = _real(found, rows[name]["value"], one.units[name], f"{name}: {words(meaning('', name))}")
        expanded = _add(real, "si:expandedUnc")
        _add(expanded, "si:uncertainty", _number(factor * rows[name]["sigma"]))
        _coverage(expanded, factor, coverage_probability(factor, nu), nu)
    covariance = covariance_of(one, free)
    if covariance is None:
        return
    region = _add(found, "si:ellipsoidalRegion")
    matrix = _add(region, "si:covarianceMatrix")
    for column, name in zip(covariance.T, free, strict=True):
        cells = _add(matrix, "si:column")
        for value, other in zip(column, free, strict=True):
            unit = si_unit(one.units[name], one.units[other])
            _given(_add(cells, "si:covariance"), [("si:value", _number(value)), ("si:unit", unit)])
    p, probability = len(free), 0.95  # of the ellipsoid of all components
    square = chdtri(p, 1.0 - probability) if np.isinf(nu) else p * fdtri(p, nu, probability)
    _coverage(region, float(np.sqrt(square)), probability, nu)


def covariance_of(one: Certificate, free: Sequence[str]) -> FloatArray | None:
    """Covariance matrix of components, in products of their units; None if the results have no correlations."""
    found: dict[str, Any] = one.camera["correlations"]
    if found["matrix"] is None:
        return None
    chosen = [found["components"].index(name) for name in free]
    sigma = np.array([one.camera["components"][name]["sigma"] for name in free])
    return np.asarray(np.array(found["matrix"])[np.ix_(chosen, chosen)] * np.outer(sigma, sigma))


def _distortion(parent: Element, one: Certificate, words: Words) -> None:
    language, factor = words.language, one.coverage or 2.0
    inside = one.table.radius <= one.covered
    unit, count = si_unit(one.unit), int(np.count_nonzero(inside))

    def listed(values: Iterable[float]) -> str:
        return " ".join(map(_number, values))

    radii = _quantity(parent, words("distance from the principal point"), language)
    pairs = [("si:valueXMLList", listed(one.table.radius[inside])), ("si:unitXMLList", unit)]
    _given(_add(radii, "si:realListXMLList"), pairs)
    shifts = _quantity(parent, words("Radial distortion, mean over all directions"), language)
    found = _add(shifts, "si:realListXMLList")
    _given(found, [("si:valueXMLList", listed(one.table.shift[inside])), ("si:unitXMLList", unit)])
    probability = coverage_probability(factor, freedom(one.view.summary))
    _given(
        _add(found, "si:expandedUncXMLList"),
        [
            ("si:uncertaintyXMLList", listed(factor * one.table.sigma[inside])),
            ("si:coverageFactorXMLList", " ".join([_plain(factor)] * count)),
            ("si:coverageProbabilityXMLList", " ".join([_plain(probability)] * count)),
        ],
    )
