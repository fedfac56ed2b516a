"""Waiting for a page that a browser draws."""

from __future__ import annotations

import time
from typing import Any

import pytest

PATIENCE = 180.0
"""Seconds a page may take on a busy machine without graphics hardware."""


def wait_until(browser: Any, condition: str) -> None:
    """Wait for a condition in the page; fails with what the browser has to say."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if browser.execute_script(f"return {condition}"):
            return
        time.sleep(0.1)
    pytest.fail(f"the page did not come to {condition}: {browser.get_log('browser')}")
