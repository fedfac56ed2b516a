"""Sets of directions and traverses of STAR*NET."""

from __future__ import annotations

from mor.formats.starnet.lines import Line
from mor.formats.starnet.measurements import need, put_distance, put_vertical
from mor.formats.starnet.network import Network


def begin_set(line: Line, network: Network) -> None:
    """DB: directions from here on belong to a new set at this station."""
    need(line, 1, "the station of the set")
    network.station = line.words[0]
    network.sets[network.station] = network.sets.get(network.station, 0) + 1


def direction(line: Line, network: Network) -> None:
    """A direction, and with DM the distance and zenith angle as well."""
    if not network.station:
        raise ValueError("expected DB with the station of the set before it")
    full = line.code == "DM"
    values = (3 if network.plane else 4) if full else 2
    need(line, values, "point, direction, distance, zenith angle, σ" if full else "point, direction, σ")
    number_ = network.sets[network.station]
    at = (network.station, None if number_ == 1 else str(number_), line.words[0])
    if line.words[0] == network.station:
        raise ValueError(f"found the station {network.station!r} itself as target")
    words = line.words
    network.add(
        "directions", (*at, network.angle(words[1]), network.sigma(words, values, "direction")), line.number
    )
    if full:
        ends = [network.station, words[0]]
        put_distance(ends, words[2], network.sigma(words, values + 1, "distance"), line, network)
        if not network.plane:
            put_vertical(ends, words[3], words, values + 2, line, network)


def end_set(line: Line, network: Network) -> None:
    """DE: the set is complete."""
    network.station = ""


def traverse(line: Line, network: Network) -> None:
    """TB with a backsight or its bearing, T for each station with what is measured to the next one, TE with the end."""
    if line.code == "TB":
        need(line, 1, "the backsight, or its bearing")
        network.traverse = [line]
        return
    if not network.traverse:
        raise ValueError("expected TB before it")
    need(line, 1, "the station")
    if len(network.traverse) > 1:
        _leg(network.traverse, line.words[0], network)
    network.traverse = (
        [*network.traverse[-1:], line] if len(network.traverse) > 1 else [*network.traverse, line]
    )
    if line.code == "TE":
        if len(line.words) > 2:
            names = (line.words[0], network.traverse[-2].words[0], line.words[2])
            network.add(
                "angle", (*names, network.angle(line.words[1]), network.sigma([], 0, "angle")), line.number
            )
        network.traverse = []


def _leg(lines: list[Line], target: str, network: Network) -> None:
    """Observation of a T line: the backsight is the station before it, or that of TB."""
    before, line = lines[-2], lines[-1]
    values = 3 if network.plane else 4
    need(line, values, "station, angle, distance, zenith angle, σ")
    words = line.words
    at, turned = words[0], network.angle(words[1])
    back = before.words[0]
    sigma = network.sigma(words, values, "angle")
    if before.code == "TB" and _is_bearing(back):
        network.add("bearing", (at, target, (network.angle(back) + turned) % 360.0, sigma), line.number)
    else:
        network.add("angle", (at, back, target, turned, sigma), line.number)
    put_distance([at, target], words[2], network.sigma(words, values + 1, "distance"), line, network)
    if not network.plane:
        put_vertical([at, target], words[3], words, values + 2, line, network)


def _is_bearing(word: str) -> bool:
    return "-" in word or (
        word[:1].upper() in "NS" and word[-1:].upper() in "EW" and any(c.isdigit() for c in word)
    )
