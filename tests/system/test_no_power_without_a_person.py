"""After a fault nothing powers, homes or moves until a person asks again: pedals and desired states don't."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow
