"""Settings of the site: `make docs` builds it into docs/_build/html."""

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
os.environ.setdefault("MPLBACKEND", "Agg")

from _site import docstrings, examples, gallery, reference, repository, tutorials  # noqa: E402

import wideberth  # noqa: E402

project = "wideberth"
author = "the authors of wideberth"
copyright = author
release = version = wideberth.__version__
ADDRESSES = repository.addresses()

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "_site", "tutorials", "gallery", "**/GALLERY_HEADER.rst"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!wideberth\.).*")]  # what other libraries define
suppress_warnings = ["config.cache"]

myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_block"]
myst_heading_anchors = 4
autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
default_role = None
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

DESCRIPTION = "Plan robot motion among people and other robots whose future is uncertain."
myst_html_meta = {
    "description": DESCRIPTION,
    "property=og:title": project,
    "property=og:type": "website",
    "property=og:description": DESCRIPTION,
    "property=og:image": f"{ADDRESSES['Documentation']}/en/latest/_static/plan.png",
    "name=twitter:card": "summary_large_image",
}

html_theme = "pydata_sphinx_theme"
html_title = "wideberth"
html_static_path = ["_static", "auto/first/plan.png"]
html_favicon = "_static/logo.svg"
html_css_files = ["site.css"]
html_sidebars = {"start": [], "glossary": []}  # pages without pages below them
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {
        "text": f"{project} {release}",
        "image_light": "_static/logo.svg",
        "image_dark": "_static/logo.svg",
    },
    "icon_links": [
        {
            "name": "Repository",
            "url": ADDRESSES["Source"],
            "icon": "fa-brands fa-github",
        }
    ],
    "show_prev_next": False,
    "navigation_with_keys": False,
    "footer_start": [],
    "footer_end": [],
    "show_toc_level": 2,
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": ["page-toc"],
}

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials", "gallery"],
    "gallery_dirs": ["auto/tutorials", "auto/gallery"],
    "filename_pattern": "",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_signature": False,
    "first_notebook_cell": tutorials.INSTALLATION,
    "remove_config_comments": True,
    "write_computation_times": False,  # its page would fetch scripts
    "plot_gallery": "True",
    "abort_on_example_error": True,
    "only_warn_on_example_error": False,
    "doc_module": (),
    "reference_url": {},
    "nested_sections": False,
}

GROUPS = reference.groups()
PAGES = reference.pages_of(GROUPS)
HOLDERS = {entry.path: entry.found for group in GROUPS for entry in group.entries}
reference.write(HERE / "auto" / "reference", GROUPS)
repository.write(HERE / "auto", sorted(HERE.glob("*.md")))
repository.forget(HERE / "auto")
examples.draw(HERE / "auto" / "examples")
examples.draw_first(HERE / "auto" / "first")
gallery.write(HERE / "auto" / "pictures")
ARRAY = re.compile(r"(?:numpy\.|~)*ndarray\[[^()]*?dtype\[[^\]]*\]\]")


def read(app, name, source):
    """Turn links to files into links between pages; write cards, and links to notebooks."""
    if not name.startswith("auto/"):
        text = examples.with_pictures(source[0]) if name == "examples" else source[0]
        source[0] = repository.linked(text, Path("docs"), name)
    elif name == "auto/gallery/index":
        source[0] = gallery.index(source[0].partition(".. raw:: html")[0])
    elif name.startswith("auto/tutorials/") and name != "auto/tutorials/index":
        source[0] = tutorials.with_notebook(source[0], name.rpartition("/")[2])


def process_docstring(app, what, name, found, options, lines):
    """Rewrite a docstring; a method's names are looked up in its class too."""
    owner = HOLDERS.get(name.rpartition(".")[0])
    lines[:] = docstrings.rewritten(lines, docstrings.linker(PAGES, found, owner))


def process_signature(app, what, name, found, options, signature, returned):
    """Write Array where the annotation spells out NumPy's generic types."""
    return (
        signature and ARRAY.sub("Array", signature),
        returned and ARRAY.sub("Array", returned),
    )


def leave_aliases(app, environment, node, shown):
    """Show an alias or a type variable of a signature as text; links in prose must lead on."""
    return shown if node.get("reftype") == "class" else None


def setup(app):
    """Connect the functions above; thumbnails are drawn after sphinx-gallery ran its scripts."""
    app.connect("builder-inited", lambda app: gallery.draw_thumbnails(), priority=900)
    app.connect("source-read", read)
    app.connect("missing-reference", leave_aliases)
    app.connect("autodoc-process-docstring", process_docstring)
    app.connect("autodoc-process-signature", process_signature)
