"""Agents and the command line: everything that runs policies in the environments and reports what came out."""
