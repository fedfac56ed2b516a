"""The least-squares problem: linearisation, elimination of tie points, datum, iteration."""
