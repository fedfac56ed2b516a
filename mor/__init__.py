"""mor: one least-squares adjustment for everything measured around an object."""

__version__ = "0.1.0"
