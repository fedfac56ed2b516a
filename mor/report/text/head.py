"""Head of the report: the verdict first, then counts, σ0, global test and datum."""

from __future__ import annotations

from mor.adjustment.solve import Outcome
from mor.quality.solved import Solved
from mor.report.summary import summary
from mor.report.text._layout import fixed, short


def section(solved: Solved) -> str:
    """Verdict and key figures."""
    data = summary(solved)
    title = data["title"] or "Adjustment"
    lines = [title, "=" * len(title), "", *verdict(solved), ""]
    rows = [
        ("observations n", str(data["observations"])),
        ("unknowns u", str(data["unknowns"])),
        (
            "datum defect d",
            f"{data['defect']}" + (f" ({', '.join(data['movements'])})" if data["movements"] else ""),
        ),
        ("datum", data["datum"]),
        ("iterations", str(data["iterations"])),
    ]
    if solved.quality is not None:
        test, sigma0 = data["global_test"], data["sigma0"]
        rows += [
            (
                "redundancy n - u + d",
                f"{data['redundancy']} (sum of redundancy numbers {data['redundancy_sum']:.6f})",
            ),
            ("sigma0 a priori", short(sigma0["apriori"])),
            ("sigma0 a posteriori", short(sigma0["aposteriori"], 7)),
            ("vTPv", f"{test['statistic']:.3f}, {_limits(test)}"),
            ("standard deviations", _multiplied(solved)),
            ("units", f"lengths {data['units']['length']}, angles {data['units']['angle']}"),
            ("residuals", "v = adjusted - observed"),
        ]
    width = max(len(name) for name, _ in rows)
    lines += [f"{name.ljust(width)}  {value}" for name, value in rows]
    return "\n".join(lines)


def verdict(solved: Solved) -> list[str]:
    """What to think of it, in plain words."""
    adjustment, quality = solved.adjustment, solved.quality
    if quality is None:
        reason = f", {adjustment.reason}" if adjustment.reason else ""
        return [f"NO SOLUTION: {adjustment.outcome.value}{reason}.", *_advice(solved)]
    lines = [f"Converged after {len(adjustment.iterations)} iterations."]
    test = quality.global_test
    if test.redundancy == 0:
        lines.append("Nothing is controlled: the redundancy is 0, there is no test.")
    elif test.accepted:
        lines.append(f"Global test accepted at the level {test.level:g}.")
    else:
        size = "larger" if test.statistic > test.upper else "smaller"
        lines.append(
            f"Global test REJECTED at the level {test.level:g}: residuals are {size} than the a-priori sigmas say "
            f"(sigma0 ratio {fixed(quality.sigma0, 3)})."
        )
    flagged = sum(int(flags.sum()) for flags in quality.flagged)
    lines.append(
        f"{flagged} observations with |w| > {quality.critical:.2f}."
        if flagged
        else "No observation is flagged."
    )
    return lines


def _advice(solved: Solved) -> list[str]:
    """What to do where the iteration led nowhere."""
    count = len(solved.adjustment.iterations)
    if solved.adjustment.outcome is Outcome.NOT_CONVERGED:
        more = f"{count} iterations were not enough; settings: {{max_iterations: …}} allows more"
        return [f"{more}, better start values need fewer."]
    if solved.adjustment.outcome is Outcome.DIVERGED:
        return [
            "Check the start values and look for gross errors: points mixed up, wrong units, wrong signs."
        ]
    return []


def _limits(test: dict[str, float]) -> str:
    return (
        f"accepted between {test['lower']:.3f} and {test['upper']:.3f} (chi-squared, level {test['level']:g})"
    )


def _multiplied(solved: Solved) -> str:
    quality = solved.quality
    posterior = quality is not None and quality.sigma_factor != 1.0
    which = "a posteriori" if posterior else "a priori"
    return f"with sigma0 {which}, in the datum: {solved.adjustment.problem.datum.name}"
