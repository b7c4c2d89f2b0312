"""`python -m waveformer` is the `waveformer` command."""

from waveformer.cli import main

main()
