"""Settings of the site: `make docs` builds it into docs/_build/html."""

import os
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
os.environ.setdefault("MPLBACKEND", "Agg")

from _site import docstrings, examples, gallery, reference, repository, tutorials
from sphinx.util.nodes import make_refnode

import wideberth

project = "wideberth"
author = copyright = "the authors of wideberth"
release = version = wideberth.__version__
ADDRESSES = repository.addresses()

extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon",
    "sphinx.ext.viewcode", "sphinx_copybutton", "sphinx_design",
    "sphinx_gallery.gen_gallery",
]  # fmt: skip
exclude_patterns = ["_build", "_site", "tutorials", "gallery", "**/GALLERY_HEADER.rst"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!wideberth\.).*")]  # what other libraries define
suppress_warnings = ["config.cache"]

myst_enable_extensions = ["colon_fence", "attrs_block"]
myst_heading_anchors = 4
napoleon_google_docstring = False
napoleon_attr_annotations = False  # the signature has them
napoleon_custom_sections = ["Returns", ("Attributes", "params_style")]
autodoc_member_order = "bysource"
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
default_role = "py:obj"
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
html_show_sourcelink = html_copy_source = False
LOGO = {"image_light": "_static/logo.svg", "image_dark": "_static/logo.svg"}
SOURCE = {"name": "Repository", "url": ADDRESSES["Source"], "icon": "fa-brands fa-github"}
html_theme_options = {
    "logo": {"text": f"{project} {release}", **LOGO},
    "icon_links": [SOURCE],
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
    "abort_on_example_error": True,
    "nested_sections": False,
}

reference.write_pages()
repository.write_pages()
gallery.write_pages()
examples.draw()
ARRAY = re.compile(r"(?:numpy\.|~)*ndarray\[[^()]*?dtype\[[^\]]*\]\]")


def read(app, name, source):
    """Turn links to files into links between pages; write cards, and links to notebooks."""
    if not name.startswith("auto/"):
        text = examples.with_pictures(source[0]) if name == "examples" else source[0]
        source[0] = repository.linked(text, Path("docs"), name)
    elif name == "auto/gallery/index":
        source[0] = gallery.index(source[0].partition(".. raw:: html")[0].rstrip())
    elif name.startswith("auto/tutorials/") and name != "auto/tutorials/index":
        source[0] = tutorials.with_notebook(source[0], name.rpartition("/")[2])


def process_docstring(app, what, name, found, options, lines):
    """Write a docstring as napoleon, which comes next, reads it."""
    first = ["\\ "] if what == "attribute" else []  # in its first line a colon would end a type
    lines[:] = [*first, *docstrings.rewritten("\n".join(lines)).splitlines()]


def process_signature(app, what, name, found, options, signature, returned):
    """Write Array where the annotation spells out NumPy's generic types."""
    return (
        signature and ARRAY.sub("Array", signature),
        returned and ARRAY.sub("Array", returned),
    )


def resolve(app, environment, node, shown):
    """Link a class that the reference has under a shorter name; leave other names as text.

    Names on the pages of guides must lead on.
    """
    if node.get("refdomain") != "py" or not node["refdoc"].startswith("auto/reference/"):
        return None
    domain = environment.domains["py"]
    last = re.fullmatch(r"(?:wideberth.*\.)?([A-Z]\w*(?:\.\w+)?)", node["reftarget"])
    found = domain.find_obj(environment, None, None, last[1], None, 1) if last else []
    if len(found) != 1:
        return shown
    (path, place) = found[0]
    return make_refnode(app.builder, node["refdoc"], place.docname, place.node_id, shown, path)


def setup(app):
    """Connect the functions above; thumbnails are drawn after sphinx-gallery ran its scripts."""
    app.connect("builder-inited", lambda app: gallery.draw_thumbnails(), priority=900)
    app.connect("source-read", read)
    app.connect("missing-reference", resolve)
    app.connect("autodoc-process-docstring", process_docstring, priority=400)
    app.connect("autodoc-process-signature", process_signature)
