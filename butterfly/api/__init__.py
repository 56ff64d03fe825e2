"""What stands behind `import butterfly as bf`: a few verbs, and results that show themselves."""
