"""The page of a folder of result files: what there is (results), tables across files, the document.

May import `experiments.figures` and `experiments.text`.
"""
