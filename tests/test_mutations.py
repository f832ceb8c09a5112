"""The mutations fit the code as it is: each piece that one replaces occurs once, and its tests are there."""

from __future__ import annotations

import pytest

from tests.mutations import MUTATIONS, Mutation
from tests.repository import REPOSITORY


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_a_mutation_fits_the_code(mutation: Mutation) -> None:
    assert (REPOSITORY / mutation.file).read_text(encoding="utf-8").count(mutation.old) == 1
    assert all((REPOSITORY / "tests" / name).is_file() for name in mutation.tests.split())
    assert mutation.new != mutation.old
