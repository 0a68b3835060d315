"""Points: one number of each of many runs, coloured by what came of the run."""

from collections.abc import Mapping, Sequence

from matplotlib.ticker import MaxNLocator

from servoloop.plots.svg import new_figure, style, svg

Points = Sequence[tuple[float, float]]
MOST = 2000
"""Points of a group; of more, only the lowest and the highest of each stretch are shown."""


def points(groups: Mapping[str, Points], colours: Sequence[str], axis: str, unit: str) -> str:
    """Points (x, y) as SVG, by the name of their group; x a whole number, y in ``unit``, finite and not negative."""
    with style():
        figure = new_figure(2.6)
        axes = figure.add_subplot()
        for (name, group), colour in zip(groups.items(), colours, strict=True):
            shown = thinned(group)
            axes.plot([x for x, _ in shown], [y for _, y in shown], ".", markersize=4, color=colour, label=name)
        highest = max((y for group in groups.values() for _, y in group), default=0.0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel=axis, ylabel=unit, ylim=(0.0, 1.08 * highest or 1.0))
        return svg(figure)


def thinned(group: Points) -> Points:
    """At most ``MOST`` points: the lowest and the highest of each stretch of x, where there are more."""
    if len(group) <= MOST:
        return group
    ordered = sorted(group)
    size = -(-len(ordered) // (MOST // 2))
    stretches = [ordered[at : at + size] for at in range(0, len(ordered), size)]
    kept = {pick(stretch, key=lambda point: point[1]) for stretch in stretches for pick in (min, max)}
    return sorted(kept)
