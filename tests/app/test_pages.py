"""Names of tabs: what a page did before its connection was lost is its own still."""

from __future__ import annotations

import pytest

from asdfviz.app.pages import Pages


def test_a_page_that_comes_back_has_all_its_names() -> None:
    pages = Pages()
    page, other = pages.open(), pages.open()
    had = {page}
    for _ in range(3):
        pages.close(page)
        assert pages.others(other) == set()
        again = pages.open()
        pages.go_on(again, page)
        page = again
        had.add(page)
        assert pages.others(other) == had
        assert pages.others(page) == {other}


def test_a_name_that_another_tab_has_is_not_to_be_had() -> None:
    pages = Pages()
    page, other = pages.open(), pages.open()
    pages.go_on(other, page)
    assert pages.others(page) == {other}
    assert pages.others(other) == {page}


def test_a_page_may_be_back_before_its_loss_is_known() -> None:
    pages = Pages()
    page, other = pages.open(), pages.open()
    again = pages.open()
    pages.go_on(again, page)
    pages.close(page)
    assert pages.others(other) == {page, again}
    assert pages.others(again) == {other}


@pytest.mark.parametrize("name", ["", "0", "A1B2C3D4", "a1b2c3d4\n", "left/drag"])
def test_what_cannot_be_a_name_is_ignored(name: str) -> None:
    pages = Pages()
    page, other = pages.open(), pages.open()
    pages.go_on(page, name)
    pages.go_on("a1b2c3d4", page)  # a tab that has gone meanwhile
    assert pages.others(other) == {page}


def test_a_name_of_before_the_app_was_opened_again_is_the_page_s() -> None:
    pages = Pages()
    page, other = pages.open(), pages.open()
    pages.go_on(page, "a1b2c3d4")
    assert pages.others(other) == {page, "a1b2c3d4"}
