"""The benchmark: a versioned suite of cases, a scorecard per method, rankings, and error against camera speed."""
