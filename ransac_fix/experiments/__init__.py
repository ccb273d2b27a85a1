"""The paper's tables and figures computed again, and the cost of the error on given numbers.

Importing this package costs nothing: every module imports what it needs.
"""
