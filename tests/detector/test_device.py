from __future__ import annotations

import pytest

from asdfviz.detector.device import require_device
from asdfviz.errors import InputError


def test_the_processor_is_always_there() -> None:
    require_device("cpu")


@pytest.mark.parametrize("name", ["toaster", "", "cuda:77"])
def test_a_device_that_is_not_there_is_one_clear_error(name: str) -> None:
    with pytest.raises(InputError, match=f"device '{name}' cannot be used here, use cpu") as caught:
        require_device(name)
    assert "\n" not in str(caught.value)
