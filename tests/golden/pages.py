# Every page below this folder: its tags are closed in order, it fetches nothing, runs no script, has each id once and what is referred to.
import html.parser, pathlib, re

single = {"meta", "link", "br", "img", "hr", "input"}


class Page(html.parser.HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.wrong = [], set(), []
        self.feed(text)
        self.close()
        self.wrong += [f"<{tag}> is not closed" for tag in self.open]
        self.wrong += [f"twice: {one}" for one in {i for i in re.findall(r"\sid=['\"]([^'\"]+)", text) if len(re.findall(rf"\sid=['\"]{re.escape(i)}['\"]", text)) > 1}]
        self.wrong += [f"nowhere: {one}" for one in set(re.findall(r"href=['\"]#([^'\"]+)", text)) - self.ids]
        self.wrong += [f"fetched: {one}" for one in re.findall(r"(?:src=['\"]|url\()(?!data:)([^'\")]+)", text)]
        self.wrong += [word for word in (">nan", ">inf", "<script") if word in text]

    def handle_starttag(self, tag, attributes):
        self.ids |= {value for key, value in attributes if key == "id"}
        if tag not in single:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.ids |= {value for key, value in attributes if key == "id"}

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(f"</{tag}> at line {self.getpos()[0]}")


for path in sorted(pathlib.Path(".").rglob("*.html")):
    print(f"{path}: {'; '.join(sorted(Page(path.read_text()).wrong)[:3]) or 'good'}")
