"""Lines of STAR*NET with measured values: what each code adds to the network."""

from __future__ import annotations

from mor.formats.starnet.lines import STATUSES, Line
from mor.formats.starnet.network import SIGMA_LEVEL, Network


def names_of(word: str, count: int, network: Network) -> list[str]:
    """Names that stand in one word. Raises ``ValueError``."""
    names = word.split(network.separator)
    if len(names) != count or not all(names):
        raise ValueError(f"found {word!r}, expected {count} names with {network.separator} between them")
    if len(set(names)) < len(names):
        raise ValueError(f"found {word!r}, expected different points")
    return names


def at_from_to(word: str, network: Network) -> list[str]:
    """Names of an angle, the station first, whatever the order in force."""
    names = names_of(word, 3, network)
    return [names[1], names[0], names[2]] if network.from_first else names


def need(line: Line, count: int, form: str) -> None:
    """Raise ``ValueError`` where a line has too few words."""
    if len(line.words) < count:
        raise ValueError(f"found {len(line.words)} words, expected {form}")


def heights(line: Line, network: Network) -> tuple[float, float]:
    """Heights of instrument and target, m."""
    a, b = line.heights or (0.0, 0.0)
    return a * network.metres, b * network.metres


def bearing(line: Line, network: Network) -> None:
    """A bearing."""
    need(line, 2, "from-to, bearing, σ")
    ends = names_of(line.words[0], 2, network)
    network.add(
        "bearing", (*ends, network.angle(line.words[1]), network.sigma(line.words, 2, "bearing")), line.number
    )


def angle(line: Line, network: Network) -> None:
    """A horizontal angle."""
    need(line, 2, "at-from-to, angle, σ")
    names = at_from_to(line.words[0], network)
    network.add(
        "angle", (*names, network.angle(line.words[1]), network.sigma(line.words, 2, "angle")), line.number
    )


def distance(line: Line, network: Network) -> None:
    """A distance: horizontal in the plane and with .DELTA ON, else along the slope."""
    need(line, 2, "from-to, distance, σ")
    put_distance(
        names_of(line.words[0], 2, network),
        line.words[1],
        network.sigma(line.words, 2, "distance"),
        line,
        network,
    )


def put_distance(ends: list[str], word: str, sigma: str | float, line: Line, network: Network) -> None:
    """A distance with its σ."""
    if network.plane or network.delta:
        network.add("horizontal_distance", (*ends, network.length(word), sigma), line.number)
    else:
        values = (*ends, network.length(word), sigma, *heights(line, network))
        network.add("distance", values, line.number)


def put_vertical(
    ends: list[str], word: str, words: list[str], place: int, line: Line, network: Network
) -> None:
    """A zenith angle, or with .DELTA ON an elevation difference between the marks."""
    if network.delta:
        own, target = heights(line, network)
        dz = network.length(word) + own - target
        network.add("height_difference", (*ends, dz, network.sigma(words, place, "height")), line.number)
    else:
        sigma = network.sigma(words, place, "zenith")
        network.add("zenith_angle", (*ends, network.angle(word), sigma, *heights(line, network)), line.number)


def vertical(line: Line, network: Network) -> None:
    """A zenith angle or an elevation difference."""
    need(line, 2, "from-to, zenith angle, σ")
    put_vertical(names_of(line.words[0], 2, network), line.words[1], line.words, 2, line, network)


def distance_and_vertical(line: Line, network: Network) -> None:
    """A distance and what goes with it in height."""
    need(line, 3, "from-to, distance, zenith angle, σ")
    ends = names_of(line.words[0], 2, network)
    put_distance(ends, line.words[1], network.sigma(line.words, 3, "distance"), line, network)
    put_vertical(ends, line.words[2], line.words, 4, line, network)


def measured(line: Line, network: Network) -> None:
    """All to a point: angle, distance and, in space, zenith angle, with their σ in this order."""
    values = 3 if network.plane else 4
    need(line, values, "at-from-to, angle, distance, zenith angle, σ")
    names, words = at_from_to(line.words[0], network), line.words
    network.add(
        "angle", (*names, network.angle(words[1]), network.sigma(words, values, "angle")), line.number
    )
    ends = [names[0], names[2]]
    put_distance(ends, words[2], network.sigma(words, values + 1, "distance"), line, network)
    if not network.plane:
        put_vertical(ends, words[3], words, values + 2, line, network)


def bearing_measured(line: Line, network: Network) -> None:
    """All to a point, by its bearing."""
    values = 3 if network.plane else 4
    need(line, values, "from-to, bearing, distance, zenith angle, σ")
    ends, words = names_of(line.words[0], 2, network), line.words
    network.add(
        "bearing", (*ends, network.angle(words[1]), network.sigma(words, values, "bearing")), line.number
    )
    put_distance(ends, words[2], network.sigma(words, values + 1, "distance"), line, network)
    if not network.plane:
        put_vertical(ends, words[3], words, values + 2, line, network)


def levelled(line: Line, network: Network) -> None:
    """Elevation difference and the length of the line: σ = 2 mm √km, unless the third value is a σ behind &."""
    need(line, 2, "from-to, elevation difference, length of the line, σ")
    words = line.words
    ends, dz = names_of(words[0], 2, network), network.length(words[1])
    if len(words) > 3:
        sigma: str | float = network.sigma(words, 3, "height")
    elif len(words) > 2 and words[2] not in STATUSES:
        length = network.length(words[2])
        if length <= 0.0:
            raise ValueError(f"found the length {words[2]}, expected a number above 0")
        network.defaults += 1
        sigma = SIGMA_LEVEL * (length / 1000.0) ** 0.5
    else:
        sigma = network.sigma(words, 2, "height")
    network.add("height_difference", (*ends, dz, sigma), line.number)
