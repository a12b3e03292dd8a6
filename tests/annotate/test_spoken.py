"""What is kept of an annotation, brought up to date by what changed."""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from asdfviz.annotate.records import StateLabel
from asdfviz.annotate.spoken import NOTHING, up_to_date
from asdfviz.annotate.store import AnnotationStore
from asdfviz.errors import AnnotationError

OpenStore = Callable[..., AnnotationStore]


def test_nothing_new_is_nothing_else(store: AnnotationStore) -> None:
    assert up_to_date(NOTHING, store) is NOTHING
    store.set_state(3, StateLabel(1))
    labelled = up_to_date(NOTHING, store)
    assert labelled.ranges == ((3, 3, StateLabel(1)),)
    assert up_to_date(labelled, store) is labelled
    store.set_pose(3, "lid", np.eye(4))
    posed = up_to_date(labelled, store)
    assert posed.ranges is labelled.ranges
    assert labelled.said == {}  # who looks at it meanwhile sees it unchanged
    assert posed.said == {(3, "lid"): ("pose", "manual")}


def test_it_says_what_the_whole_file_says(open_store: OpenStore) -> None:
    """Edits, undo and redo of two people at random, looked at now and then."""
    stores, rng, known = (open_store("ada"), open_store("bob")), random.Random(0), NOTHING
    for _ in range(400):
        store, frame, part = rng.choice(stores), rng.randrange(3), rng.choice(("lid", "pin"))
        group = rng.choice((None, "one", "two"))
        match rng.randrange(8):
            case 0:
                store.set_pose(frame, part, np.eye(4), group=group)
            case 1:
                store.verify(frame, part, np.eye(4), provenance="keys", group=group)
            case 2:
                store.remove_pose(frame, part, group=group)
            case 3:
                store.drop_pose(frame, part, group=group)
            case 4:
                store.set_state(frame, StateLabel(rng.randrange(2)), group=group)
            case number:
                with suppress(AnnotationError):  # somebody else changed the same since
                    store.redo() if number == 7 else store.undo()
        if rng.random() < 0.3:
            known, afresh = up_to_date(known, stores[0]), up_to_date(NOTHING, stores[0])
            assert known.said == afresh.said == store.said()
            assert known.verdicts == afresh.verdicts
            assert known.ranges == store.state_ranges()
