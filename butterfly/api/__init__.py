"""The Python interface, `import butterfly as bf`: a few verbs, and their results."""
