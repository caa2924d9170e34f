// Search runs in a worker, which browsers refuse to pages that are opened as files: there a hidden frame takes its place.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.documentElement.append(this.frame);
      const from = new URL(url, location.href); // the worker's own address, from which it names what it imports
      const loads = (names) => names.map((name) => `<script src="${new URL(name, from)}"><\/script>`).join("");
      const inside = this.frame.contentWindow;
      inside.document.open();
      inside.postMessage = (data) => this.answer(data);
      inside.importScripts = (...names) => (inside.document.write(loads(names)), Promise.resolve());
      inside.document.write(loads([from]));
      inside.document.close();
      this.ready = new Promise((resolve) => inside.addEventListener("load", resolve, { once: true }));
    }

    answer(data) {
      const event = new MessageEvent("message", { data });
      this.dispatchEvent(event);
      if (this.onmessage) this.onmessage(event);
    }

    postMessage(data) {
      this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data })));
    }

    terminate() {
      this.frame.remove();
    }
  };
}
