"""Importers, one module a format: ``HELP`` is a phrase, ``import_file(path, map_path)`` gives an ``Imported``.

A new format is a new module here, or an entry point of the group ``ambient_trainer.data.importers`` that names one;
it is listed nowhere else. ``NEEDS_MAP = True`` says that it cannot do without a map. Modules whose name starts with
``_`` are no formats.
"""
