"""Registers the bundled tasks and the policies trained for them."""

from __future__ import annotations

from hpp_framework.plugins.registry import Hub


def register(hub: Hub) -> None:
    """Add every task of this package."""
    hub.tasks.add("rendezvous", "hpp_tasks.rendezvous:rendezvous", summary="meet anywhere, at rest (Eq. 1)")
    hub.tasks.add(
        "rendezvous-accumulated",
        "hpp_tasks.rendezvous:accumulated_distance",
        summary="rendezvous scored by the distance summed over the trajectory (rejected in the paper)",
    )
    for name, summary in (
        ("formation", "a line, ring or shape of one's own, anywhere, at rest"),
        ("region", "meet at a given place"),
        ("handover", "two robots face to face, within arm's reach"),
        ("dispersion", "all robots far from each other"),
        ("follow", "keep at a distance from a leader who goes where it likes"),
        ("pursuit", "stay near a stranger who goes where it likes"),
    ):
        hub.tasks.add(name, f"hpp_tasks.{name}:{name}", summary=summary)
    for module, name, summary in (
        ("distances", "spread", "distance of each pair (Eq. 1)"),
        ("distances", "gather", "distance from the team's centre, beyond a radius"),
        ("distances", "spacing", "distances of all pairs within a range"),
        ("distances", "clearance", "gaps between footprints"),
        ("distances", "distance", "distance of two named robots within a range"),
        ("places", "region", "distance from a disc"),
        ("places", "coverage", "distance of an area's points from the nearest robot"),
        ("headings", "facing", "angle at which two named robots see each other"),
        ("formation", "formation", "distance from one's place in a shape"),
        ("leaders", "escort", "distances of all others from a named leader within a range"),
        ("leaders", "caught", "distance of the nearest robot from a named stranger"),
    ):
        hub.terms.add(name, f"hpp_tasks.terms.{module}:{name}", summary=summary)
    hub.checkpoints.add(
        "hpp_tasks.rendezvous",
        "hpp_tasks.rendezvous:policy_folder",
        summary="policies trained for rendezvous",
    )
