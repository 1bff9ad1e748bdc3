"""The paper's tables and figures from one command: every scene of the paper that is there, or its stand-in.

- ``scenes``: which scenes are there, as datasets or as stand-ins
- ``study``: jobs of a batch, and their results
- ``fit``: the thresholds that the paper did not publish, from datasets
- ``tables``, ``figures``, ``output``: Tables 1 to 4 beside the paper's, Figures 1 and 2, page and LaTeX file
"""
