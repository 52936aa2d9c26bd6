"""The benchmark: policies on all scenarios in parallel, their standings, the pages that show them, tuning of HSC."""
