"""waveformer: from a mesh to radar echoes, and from echoes back to the complete shape.

Folder order = data order = import order:
    simulator   mesh -> scene -> visibility -> raw signal H, and its imaging adjoint
    datagen     many meshes -> datasets
    model       H -> image -> candidate surfaces -> completed shape
    eval        metrics, tables, figures
    cli         the typer commands
"""

__version__ = "0.1.0"
