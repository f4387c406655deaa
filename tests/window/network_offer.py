#!/usr/bin/env python3
"""Takes the offer of a network in the window of OSTRA, from a local server, with a screenshot of each step.

    cargo build --release
    tests/window/network_offer.py SHOTS [--program PATH] [--runtime WHEEL]

The server is a mirror (OSTRA_MIRROR) with a certificate of its own. It has the small networks of tests/parity/public under
the address of MobileSAM, which have its interface and find what has the colour of the clicked place. ONNX Runtime is the
library named in ORT_DYLIB_PATH. With `--runtime`, it is installed from the server, too: WHEEL is the file that
`ostra models addresses onnxruntime` names.

The script makes the example, clicks on the wall, takes the offer, and checks that the same click is answered with the network.
"""

import argparse
import hashlib
import http.server
import os
import re
import ssl
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from driver import Display, Window  # noqa: E402

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
# Size of the frames of the example, a frame, and a pixel of the red strip on its wall.
FRAME_SIZE, FRAME, STRIP = (480, 640), re.compile("^Frame 6, "), (115, 355)


class Mirror:
    """A server of files by the end of their address, with ranges, that waits before it sends the rest of a file."""

    def __init__(self, files, folder):
        self.files, self.requests = files, []
        self.may_finish = threading.Event()
        self.certificate = os.path.join(folder, "certificate.pem")
        key = os.path.join(folder, "key.pem")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
                        "-addext", "subjectAltName=DNS:localhost", "-addext", "basicConstraints=critical,CA:FALSE",
                        "-keyout", key, "-out", self.certificate],
                       check=True, capture_output=True)
        mirror = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self):
                mirror.answer(self)

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.certificate, key)
        self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.address = f"https://localhost:{self.server.server_port}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def answer(self, request):
        self.requests.append((request.path, request.headers.get("Range")))
        name = request.path.rsplit("/", 1)[-1]
        if name not in self.files:
            request.send_error(404)
            return
        with open(self.files[name], "rb") as file:
            data = file.read()
        wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", request.headers.get("Range", ""))
        first, last = 0, len(data) - 1
        if wanted:
            first, last = int(wanted[1]), min(int(wanted[2] or last), last)
            request.send_response(206)
            request.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
        else:
            request.send_response(200)
        request.send_header("Content-Length", str(last + 1 - first))
        request.send_header("ETag", f'"{hashlib.sha256(data).hexdigest()}"')
        request.end_headers()
        middle = (first + last + 1) // 2
        request.wfile.write(data[first:middle])
        self.may_finish.wait(300)
        request.wfile.write(data[middle:last + 1])

    def close(self):
        self.may_finish.set()
        self.server.shutdown()


def catalogue(folder, files):
    """Writes the catalogue of the program with sizes and digests of these files in place of those of MobileSAM."""
    with open(os.path.join(ROOT, "assets", "models.toml"), encoding="utf-8") as file:
        text = file.read()
    for name, path in files.items():
        with open(path, "rb") as file:
            data = file.read()
        facts = f'bytes = {len(data)}\nsha256 = "{hashlib.sha256(data).hexdigest()}"'
        text, count = re.subn(rf'({name}"\n)bytes = \d+\nsha256 = "\w+"', rf"\g<1>{facts}", text)
        assert count == 1, name
    path = os.path.join(folder, "networks.toml")
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)
    return path


def story(window, mirror):
    """Makes the example, clicks, takes the offer, and returns its text."""
    window.click("Try the example plant")
    window.shot("making-the-example")
    window.wait_for("Fit", 600)
    window.wait_until_idle()
    window.click(FRAME)
    window.wait_until_idle()
    window.shot("example")
    window.click_image(*STRIP, FRAME_SIZE)
    offer = window.wait_for(re.compile(r"^MobileSAM \("), 60).name
    window.wait_for(re.compile("^segmenter: (builtin|geometry)"), 60)
    time.sleep(1)  # The bar appears gradually.
    window.shot("offered")
    window.click("Install")
    window.wait_for(re.compile("^Installing "), 60)
    window.wait(lambda: mirror.requests, 60, "nothing is requested")
    time.sleep(1)
    window.shot("installing")
    mirror.may_finish.set()
    window.wait(lambda: not window.look(re.compile("^(Installing |MobileSAM )")), 120, "the installation does not end")
    window.wait_for(re.compile("^segmenter: sam"), 60)
    window.wait_until_idle()
    window.shot("answered-again")
    # The answer took the place of the first one.
    window.find("Smaller")
    window.key("ctrl+z")
    window.wait_until_idle()
    window.find(re.compile("^Frame 6, no mask"))
    window.shot("undone")
    return offer


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shots")
    parser.add_argument("--program", default="target/release/ostra")
    parser.add_argument("--runtime", metavar="WHEEL")
    options = parser.parse_args()
    public = os.path.join(ROOT, "tests", "parity", "public")
    networks = {"mobile_sam_image_encoder.onnx": os.path.join(public, "encoder-hwc.onnx"),
                "sam_mask_decoder_multi.onnx": os.path.join(public, "decoder-multi.onnx")}
    with tempfile.TemporaryDirectory() as folder:
        files = dict(networks)
        environment = {"OSTRA_NETWORKS": catalogue(folder, networks)}
        if options.runtime:
            files[os.path.basename(options.runtime)] = os.path.abspath(options.runtime)
        else:
            environment["ORT_DYLIB_PATH"] = os.environ["ORT_DYLIB_PATH"]
        mirror = Mirror(files, folder)
        environment |= {"OSTRA_MIRROR": mirror.address, "SSL_CERT_FILE": mirror.certificate, "NO_PROXY": "localhost"}
        display = Display(1280, 800)
        try:
            window = Window(os.path.abspath(options.program), options.shots, environment=environment)
            try:
                offer = story(window, mirror)
                ranges = [f"{path.rsplit('/', 1)[-1]} {asked or ''}".strip() for path, asked in mirror.requests]
                print(f"{window.report('offer')}; {offer}; requests: {', '.join(ranges)}")
            finally:
                window.close()
        finally:
            display.close()
            mirror.close()


if __name__ == "__main__":
    main()
