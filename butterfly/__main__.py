"""`python -m butterfly` is the command line too."""

from butterfly.cli import main

main()
