"""A report's page as the tests read it."""

import html.parser
import re

SECTIONS = ["record", "where", "ranking", "shrink", "apart", "identifiability", "model", "warnings", "provenance"]
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Page(html.parser.HTMLParser):
    """Checks nesting while reading, and keeps what the tests ask for."""

    def __init__(self, source):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.ids, self.sections, self.text, self.data, self.wrong = [], [], [], [], [], [], []
        self.feed(source)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "section":
            self.sections.append(attributes["id"])
        if tag == "data":
            self.data.append([attributes["value"], ""])
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1] == tag, f"</{tag}> closes <{self.open[-1]}>"
        self.open.pop()

    def handle_data(self, data):
        if "style" not in self.open and "script" not in self.open:
            self.text.append(data)
        if self.open and self.open[-1] == "data":
            self.data[-1][1] += data


def scripts(source):
    """Every script's text."""
    return re.findall(r"<script[^>]*>(.*?)</script>", source, flags=re.DOTALL)
