"""The page of `contactfusion live --web`: the server by requests, the page in a real browser."""

import http.client
import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from contactfusion.arrays import FloatArray
from contactfusion.errors import ConfigurationError
from contactfusion.live.page import CLIENTS, LONGEST, Address, Page
from tests.browser import CHROMIUM, Browser

HOSTILE = "<img src=x onerror=window.broken=1>\"'; \\"
SURFACE = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.2]])


class Running:
    """What a page shows: a probe that is pressed, which changes ten times a second."""

    def __init__(self) -> None:
        self.orders: list[str] = []
        self.surface: tuple[int, FloatArray] = (1, SURFACE)
        self.silent = False
        self.fields: dict[str, Any] = {
            "configuration": "probe",
            "stopped": "",
            "cycle": {"rate": 100.0, "took": 0.0012, "slowest": 0.003, "overruns": 0},
            "recording": "",
            "frame": "probe",
            "contacts": [
                {
                    "track": 1,
                    "position": [0.1, 0.0, 0.0],
                    "probability": 0.93,
                    "force": [0.0, 0.0, -5.0],
                    "since": 1.0,
                    "sources": {"wrist": 1.0},
                }
            ],
            "sources": [source("wrist"), source("eye", health="silent", reason="nothing for 2 s")],
            "events": [{"time": 1.0, "text": "contact 1 made", "level": "info"}],
            "surface": 1,
        }
        self._known, self._began = dict[str, Any](), time.monotonic()

    def status(self) -> dict[str, Any]:
        now = round(time.monotonic() - self._began, 1)
        if not self.silent and now != self._known.get("now"):
            self._known = {**self.fields, "now": now, "surface": self.surface[0]}
        return self._known

    def change(self, text: str) -> str:
        if "eye" in text:
            raise ConfigurationError("'eye' takes no tare")
        self.orders.append(text)
        return f"done: {text}"

    def page(self, host: str = "127.0.0.1", port: int = 0) -> Page:
        return Page(host, port, self.status, lambda: self.surface, self.change)


def source(name: str, **other: Any) -> dict[str, Any]:
    """A source as `Status.fields` has it."""
    return {
        "name": name,
        "kind": "support",
        "topic": f"/{name}",
        "rate": 100.0,
        "age": 0.01,
        "share": 0.5,
        "health": "ok",
        "reason": "",
        "tares": True,
        **other,
    }


@pytest.fixture
def running() -> Running:
    return Running()


@pytest.fixture
def page(running: Running) -> Iterator[Page]:
    with running.page() as served:
        yield served


def ask(
    page: Page, path: str = "/", body: bytes | None = None, **headers: str
) -> tuple[int, bytes, http.client.HTTPMessage]:
    """Status, body and headers of an answer; to a POST from the page where there is a body."""
    with closing(connected(page)) as connection:
        method = "GET" if body is None else "POST"
        if body is not None:
            headers.setdefault("Host", "localhost")
            headers.setdefault("Origin", f"http://{headers['Host']}")
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read(), answer.headers


def connected(page: Page) -> http.client.HTTPConnection:
    return http.client.HTTPConnection("127.0.0.1", page.server_address[1], timeout=10.0)


def streamed(page: Page) -> tuple[http.client.HTTPConnection, http.client.HTTPResponse]:
    """A stream of the status that has begun."""
    connection = connected(page)
    connection.request("GET", "/status")
    return connection, connection.getresponse()


def statuses(answer: http.client.HTTPResponse) -> Iterator[dict[str, Any]]:
    for line in answer:
        if line.startswith(b"data: "):
            yield json.loads(line.removeprefix(b"data: "))


def until(is_so: Callable[[], bool]) -> None:
    ends = time.monotonic() + 10.0
    while not is_so():
        assert time.monotonic() < ends, "it never was"
        time.sleep(0.02)


def streams() -> int:
    """The number of threads that answer requests."""
    return sum("process_request_thread" in thread.name for thread in threading.enumerate())


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("8080", ("127.0.0.1", 8080)),
        ("0.0.0.0:80", ("0.0.0.0", 80)),
        ("[::1]:8080", ("::1", 8080)),
        (":0", ("127.0.0.1", 0)),
    ],
)
def test_an_address_is_a_port_and_perhaps_a_host(text: str, address: tuple[str, int]) -> None:
    assert Address.of(text) == address


@pytest.mark.parametrize("text", ["", "robot", "robot:", "70000", "-1", "8080/"])
def test_what_is_no_address_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"is no \[HOST:\]PORT, such as 8080"):
        Address.of(text)


def test_a_taken_port_and_an_unknown_host_are_one_sentence(page: Page, running: Running) -> None:
    port = page.server_address[1]
    with pytest.raises(ConfigurationError, match=f"at 127.0.0.1:{port}: Address already in use"):
        running.page(port=int(port))
    with pytest.raises(ConfigurationError, match="can't be served at no.such.host.invalid:0: "):
        running.page("no.such.host.invalid")
    with pytest.raises(ConfigurationError, match=r"--web: 'robot\.\.local' is no name of a host"):
        running.page("robot..local")


def test_the_page_needs_nothing_but_its_own_server(page: Page) -> None:
    code, body, headers = ask(page)
    assert code == 200
    assert not re.search(rb"https?://(?!www\.w3\.org/2000/svg)|@import|url\(", body)
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_the_status_streams_as_it_changes(page: Page, running: Running) -> None:
    connection, answer = streamed(page)
    with closing(connection):
        began = time.monotonic()
        came = [status for status, _ in zip(statuses(answer), range(11), strict=False)]
        assert 0.8 < time.monotonic() - began < 1.5
    assert len({status["now"] for status in came}) == 11
    assert came[-1]["contacts"] == running.fields["contacts"]


def test_the_surface_is_served_as_numbers(page: Page) -> None:
    _, body, _ = ask(page, "/surface")
    assert np.frombuffer(body, "<f4").reshape(-1, 3) == pytest.approx(SURFACE)


def test_orders_are_carried_out_or_refused_with_a_sentence(page: Page, running: Running) -> None:
    assert ask(page, "/change", b"tare wrist")[:2] == (200, b"done: tare wrist")
    assert ask(page, "/change", b"record start")[:2] == (200, b"done: record start")
    assert ask(page, "/change", b"tare eye")[:2] == (409, b"'eye' takes no tare")
    assert running.orders == ["tare wrist", "record start"]


@pytest.mark.parametrize(
    "order", [b"plug a type=os", b"record start /etc/passwd", b"status", b"", b"tare a\nplug b"]
)
def test_what_loads_code_or_names_files_is_for_ctl(
    page: Page, running: Running, order: bytes
) -> None:
    assert ask(page, "/change", order)[0] == 403
    assert running.orders == []


@pytest.mark.parametrize("length", [LONGEST + 1, 300_000, int("9" * 4000)])
def test_a_long_order_is_refused(page: Page, running: Running, length: int) -> None:
    with closing(connected(page)) as connection:
        connection.putrequest("POST", "/change")
        connection.putheader("Content-Length", str(length))
        connection.putheader("Origin", f"http://127.0.0.1:{page.server_address[1]}")
        connection.endheaders(b"x" * min(length, 65536))
        assert connection.getresponse().status == 413
    assert running.orders == []


@pytest.mark.parametrize("length", ["-1", "many", "²"])
def test_an_order_without_a_length_is_refused(page: Page, length: str) -> None:
    head = f"POST /change HTTP/1.0\r\nHost: localhost\r\nContent-Length: {length}\r\n\r\n"
    with socket.create_connection(("127.0.0.1", int(page.server_address[1]))) as connection:
        connection.sendall(head.encode("latin-1"))
        assert b" 411 " in connection.recv(100)


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example:80", "", "127.0.0.1.x"])
def test_a_foreign_name_of_this_machine_is_refused(page: Page, host: str) -> None:
    for path in ("/", "/status", "/surface"):
        assert ask(page, path, Host=host)[0] == 403
    assert ask(page, "/change", b"tare wrist", Host=host)[0] == 403


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9000", "127.0.0.1:1", "[::1]:80"])
def test_names_of_the_loopback_interface_are_taken_by_any_port(page: Page, host: str) -> None:
    assert ask(page, Host=host)[0] == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://localhost", ""])
def test_what_another_site_asks_for_is_refused(page: Page, running: Running, origin: str) -> None:
    for path, body in (("/change", b"tare wrist"), ("/status", None)):
        assert ask(page, path, body, Host="localhost", Origin=origin)[0] == 403
    assert running.orders == []
    with closing(connected(page)) as connection:  # a browser names the origin of each POST
        connection.request("POST", "/change", b"tare wrist")
        assert connection.getresponse().status == 403
    ours = "http://localhost"
    assert ask(page, "/change", b"tare wrist", Host="localhost", Origin=ours)[0] == 200


def test_beyond_this_machine_it_takes_the_token_once_and_then_its_cookie(running: Running) -> None:
    with running.page("0.0.0.0") as page:
        token = page.url.partition("?token=")[2]
        assert len(token) > 20
        for path in ("/", "/?token=", "/?token=wrong", "/status", "/surface"):
            code, body, headers = ask(page, path)
            assert code == 403
            assert b"open the link with the token" in body
            assert "Set-Cookie" not in headers
        assert ask(page, "/change", b"tare wrist", Cookie="contactfusion=; \xff")[0] == 403
        code, _, headers = ask(page, f"/?token={token}", Host="robot.local")
        assert code == 200
        cookie, *limits = headers["Set-Cookie"].split("; ")
        assert set(limits) == {"HttpOnly", "SameSite=Lax", "Path=/"}
        assert ask(page, "/", Cookie=f"a=b; {cookie}")[0] == 200
        assert ask(page, "/change", b"tare wrist", Cookie=cookie)[0] == 200
        assert ask(page, "/change", b"tare wrist", Cookie=cookie, Origin="http://a.b")[0] == 403


@pytest.mark.parametrize("target", ["/../page.py", "/%2e%2e/page.py", "http://[", "/page.py"])
def test_nothing_else_is_served(page: Page, target: str, capfd: pytest.CaptureFixture[str]) -> None:
    head = f"GET {target} HTTP/1.0\r\nHost: localhost\r\n\r\n"
    with socket.create_connection(("127.0.0.1", int(page.server_address[1]))) as connection:
        connection.sendall(head.encode())
        assert b" 404 " in connection.recv(100)
    assert capfd.readouterr().err == ""


def test_a_request_that_drips_in_ends(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("contactfusion.live.page.PATIENCE", 0.5)
    with socket.create_connection(("127.0.0.1", int(page.server_address[1]))) as slow:
        slow.sendall(b"GET / HTTP/1.0\r\n")
        until(lambda: streams() == 1)
        began = time.monotonic()
        with pytest.raises(OSError, match="reset|pipe"):
            while time.monotonic() - began < 5.0:
                slow.sendall(b"X")
                time.sleep(0.1)
    until(lambda: streams() == 0)


def test_nothing_is_sent_before_there_is_a_status(page: Page, running: Running) -> None:
    running.silent = True
    connection, answer = streamed(page)
    with closing(connection):
        time.sleep(0.3)
        running.silent = False
        assert next(statuses(answer))["configuration"] == "probe"


def test_a_client_that_goes_away_leaves_no_thread(page: Page) -> None:
    before = streams()
    connection, answer = streamed(page)
    next(statuses(answer))
    assert streams() == before + 1
    answer.close()
    connection.close()
    until(lambda: streams() == before)


def test_a_client_that_is_gone_is_noticed_though_nothing_changes(
    page: Page, running: Running
) -> None:
    running.status()
    running.silent = True
    connection, answer = streamed(page)
    next(statuses(answer))
    before = streams()
    answer.close()
    connection.close()
    until(lambda: streams() == before - 1)


def test_a_client_that_reads_nothing_holds_up_no_other(
    page: Page, running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactfusion.live.page.PATIENCE", 0.5)
    running.fields["events"] = [{"time": 0.0, "text": "x" * 3_000_000, "level": "info"}]
    with socket.create_connection(("127.0.0.1", int(page.server_address[1]))) as slow:
        slow.sendall(b"GET /status HTTP/1.0\r\nHost: localhost\r\n\r\n")
        until(lambda: streams() == 1)
        assert ask(page, "/change", b"tare wrist")[0] == 200
        until(lambda: streams() == 0)


def test_so_many_pages_are_open_and_no_more(page: Page) -> None:
    held = [streamed(page) for _ in range(CLIENTS)]
    assert {answer.status for _, answer in held} == {200}
    assert ask(page, "/status")[:2] == (503, f"{CLIENTS} pages are open already".encode())
    assert ask(page, "/change", b"tare wrist")[0] == 200
    for connection, answer in held:
        answer.close()
        connection.close()
    until(lambda: streams() == 0)
    connection, answer = streamed(page)
    assert answer.status == 200
    answer.close()
    connection.close()


def test_streams_end_with_the_page(running: Running) -> None:
    with running.page() as page:
        connection, answer = streamed(page)
        next(statuses(answer))
    with closing(connection):
        assert len(list(statuses(answer))) < 5
    until(lambda: streams() == 0)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no chromium is installed")
    with Browser(tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


TEXT = "document.getElementById('{}').textContent"
RATE = "Number(document.body?.dataset.rate ?? 0)"


def opened(browser: Browser, page: Page) -> None:
    browser.open("about:blank")
    browser.open(page.url)
    browser.wait(RATE)


def test_updates_reach_the_browser_five_times_a_second(browser: Browser, page: Page) -> None:
    opened(browser, page)
    time.sleep(2.0)
    assert browser.value(RATE) >= 5.0
    assert browser.value("points.length") == SURFACE.size
    assert browser.value("document.body.className") == ""
    row = browser.value("document.querySelector('#contacts tbody').textContent")
    assert row.startswith("10.100, 0.000, 0.000 m · wrist 100\u00a0%0.935.0")


def test_buttons_order_a_tare_and_a_recording(
    browser: Browser, page: Page, running: Running
) -> None:
    opened(browser, page)
    browser.click("[aria-label='Tare wrist']")
    browser.wait(TEXT.format("answer"), lambda text: text == "done: tare 'wrist'")
    browser.click("[aria-label='Tare eye']")
    browser.wait(TEXT.format("answer"), lambda text: text == "'eye' takes no tare")
    browser.click("#record")
    until(lambda: running.orders == ["tare 'wrist'", "record start"])
    running.fields["recording"] = "now.mcap"
    browser.wait(TEXT.format("record"), lambda text: text == "Stop recording")
    assert browser.value(TEXT.format("file")) == "now.mcap"
    browser.click("#record")
    until(lambda: running.orders[-1] == "record stop")


def test_names_are_shown_as_text(browser: Browser, page: Page, running: Running) -> None:
    running.fields |= {
        "configuration": HOSTILE,
        "frame": HOSTILE,
        "stopped": HOSTILE,
        "recording": HOSTILE,
        "sources": [source(HOSTILE, topic=HOSTILE, reason=HOSTILE, health=HOSTILE)],
        "events": [{"time": 1.0, "text": HOSTILE, "level": HOSTILE}],
    }
    running.fields["contacts"][0]["sources"] = {HOSTILE: 1.0}
    opened(browser, page)
    for part in ("name", "frame", "stopped", "file", "contacts", "sources", "events"):
        assert HOSTILE in browser.value(TEXT.format(part))
    assert browser.value("document.images.length") == 0
    assert browser.value("window.broken === undefined")
    browser.click("#sources button")
    until(lambda: bool(running.orders))
    browser.wait(TEXT.format("answer"), lambda text: text == f"done: {running.orders[0]}")


def test_a_stop_is_seen_and_so_is_a_status_that_grows_old(
    browser: Browser, page: Page, running: Running
) -> None:
    opened(browser, page)
    assert browser.value("document.getElementById('stopped').hidden")
    running.fields["stopped"] = "nothing from wrist for 0.3 s"
    browser.wait(TEXT.format("stopped"), lambda text: text.endswith("nothing from wrist for 0.3 s"))
    assert browser.value("document.getElementById('stopped').checkVisibility()")
    running.silent = True
    browser.wait("document.body.className", lambda name: name == "stale")
    assert "what is shown is old" in browser.value(TEXT.format("stale"))
    running.silent = False
    browser.wait("document.body.className", lambda name: name == "")


def test_it_connects_again_to_a_server_that_comes_back(browser: Browser, running: Running) -> None:
    with running.page() as page:
        opened(browser, page)
    browser.wait("document.body.className", lambda name: name == "stale")
    running.fields["configuration"] = "again"
    with running.page(port=int(page.server_address[1])):
        browser.wait(TEXT.format("name"), lambda name: name == "again")
        assert browser.value("document.body.className") == ""


def test_the_token_leaves_the_address_bar_and_the_cookie_stays(
    browser: Browser, running: Running
) -> None:
    with running.page("0.0.0.0") as page:
        browser.open("about:blank")
        token = page.url.partition("?")[2]
        browser.open(f"http://127.0.0.1:{page.server_address[1]}/?{token}")
        browser.wait(RATE)
        assert browser.value("location.search") == ""
        browser.value("location.reload()")
        browser.wait("performance.now() < 5000 && " + RATE)


def test_a_new_surface_is_fetched_and_the_view_turns(
    browser: Browser, page: Page, running: Running
) -> None:
    opened(browser, page)
    browser.wait("points.length", lambda number: number == SURFACE.size)
    running.surface = 2, np.concatenate([SURFACE, SURFACE + 0.1])
    browser.wait("points.length", lambda number: number == 2 * SURFACE.size)
    before = browser.value("camera.azimuth")
    browser.mouse("mousePressed", 400, 400)
    browser.mouse("mouseMoved", 500, 400)
    browser.mouse("mouseReleased", 500, 400)
    assert browser.value("camera.azimuth") == pytest.approx(before - 0.8)
    browser.mouse("mouseWheel", 400, 400, deltaX=0, deltaY=-200, button="none")
    browser.wait("camera.zoom", lambda zoom: zoom > 1.2)


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_nothing_is_wider_than_the_page(
    browser: Browser, page: Page, running: Running, size: tuple[int, int]
) -> None:
    running.fields["configuration"] = running.fields["recording"] = "long_" * 30
    running.fields["sources"] += [source("long_" * 20, reason="word " * 50)]
    browser.resize(*size)
    opened(browser, page)
    assert browser.value("document.documentElement.scrollWidth") == size[0]
    browser.resize(1280, 800)
