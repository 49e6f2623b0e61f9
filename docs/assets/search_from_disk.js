// Search on pages that are opened from the disk: browsers start no worker there, so the script of
// the worker runs in a hidden frame, which passes messages on as a worker does.
"use strict";
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(script) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.appendChild(frame);
      const inner = frame.contentWindow;
      inner.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      inner.importScripts = (...urls) => Promise.all(urls.map((url) => this.#load(frame, url)));
      this.inner = inner;
      this.loaded = this.#load(frame, script);
    }

    #load(frame, url) {
      return new Promise((resolve, reject) => {
        const element = frame.contentDocument.createElement("script");
        element.src = url;
        element.onload = resolve;
        element.onerror = reject;
        frame.contentDocument.head.appendChild(element);
      });
    }

    postMessage(data) {
      this.loaded.then(() => this.inner.dispatchEvent(new MessageEvent("message", { data })));
    }

    terminate() {}
  };
}
