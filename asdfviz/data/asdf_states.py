"""How the ASDF authors name states, and how their files are read where they say nothing.

Their labels are `<Assembly>_State_<n>`. State 0, the bare base part, has no class and no box in their
files (their own script drops it), so a frame without a state box is read as state 0. Their files know
no error states; a box of a state says that there is none, its absence says nothing about it.
"""

from __future__ import annotations

import re

from asdfviz.data.truth import StateTruth
from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError

STATE_LABEL = re.compile(r".+_State_(\d+)")

NO_BOX = StateTruth(state=0, is_error=None, attached=None)
"""What a frame without a state box means."""


def state_truth(label: str, assembly: Assembly, *, where: str) -> StateTruth:
    """Read a state's label: a detector class or name of the assembly's states, or `..._State_<n>`.

    Raises:
        SequenceError: the assembly has no such state.
    """
    for state in assembly.states:
        if label in (state.detector_class, state.name):
            error = state.name if state.is_error else None
            return StateTruth(state.completed, state.is_error, attached=None, error=error)
    match = STATE_LABEL.fullmatch(label)
    if match is None or int(match[1]) >= len(assembly.steps):
        raise SequenceError(
            f"{where}: state '{label}' is unknown; {assembly.name} has the states 0 to "
            f"{len(assembly.steps) - 1}, written like {assembly.name}_State_1"
        )
    return StateTruth(state=int(match[1]), is_error=False, attached=None)
