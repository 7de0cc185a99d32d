"""Formulas as MathML, by the converter of docutils: nothing has to be loaded to show them."""

import html

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    text = node.astext().strip().replace(r"\dots", r"\ldots")
    if as_block and r"\begin" not in text and ("&" in text or r"\\" in text):
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    try:
        # without a mathematical font, browsers set an accent into its letter
        return latex2mathml.tex2mathml(text, as_block=as_block).replace(' accent="true"', "")
    except latex2mathml.MathError as error:
        logger.warning("formula %r: %s", text, error, location=node)
        return f"<code>{html.escape(text)}</code>"


def inline(translator: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula within a line."""
    translator.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def block(translator: HTML5Translator, node: nodes.Element) -> None:
    """Write a formula of its own."""
    translator.body.append(f'<div class="math">{_mathml(node, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
