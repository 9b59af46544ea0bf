"""Registers the bundled tasks and the policies trained for them."""

from __future__ import annotations

from hpp_framework.registry import Hub


def register(hub: Hub) -> None:
    """Add every task of this package."""
    hub.tasks.add("rendezvous", "hpp_tasks.rendezvous:rendezvous", summary="meet anywhere, at rest (Eq. 1)")
    hub.tasks.add(
        "rendezvous-accumulated",
        "hpp_tasks.rendezvous:accumulated_distance",
        summary="rendezvous scored by the distance summed over the trajectory (rejected in the paper)",
    )
    hub.checkpoints.add(
        "hpp_tasks.rendezvous",
        "hpp_tasks.rendezvous:policy_folder",
        summary="policies trained for rendezvous",
    )
