// The search runs in a worker, which browsers refuse to pages opened from the disk: there an iframe does its work.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      this.ready = false;
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      const inside = frame.contentWindow;
      inside.postMessage = (data) => {
        const message = new MessageEvent("message", { data });
        this.dispatchEvent(message);
        if (this.onmessage) this.onmessage(message);
      };
      inside.importScripts = (...urls) =>
        urls.reduce((before, one) => before.then(() => new Promise((done, failed) => {
          const script = frame.contentDocument.createElement("script");
          script.src = one;
          script.onload = done;
          script.onerror = failed;
          frame.contentDocument.body.append(script);
        })), Promise.resolve());
      // the search's index, which the page loads as a script
      Object.defineProperty(inside, "__index", { get: () => window.__index });
      this.inside = inside;
      inside.importScripts(String(url)).then(() => {
        this.ready = true;
        this.waiting.forEach((data) => this.send(data));
        this.waiting = [];
      });
    }
    send(data) {
      const message = new MessageEvent("message", { data });
      this.inside.dispatchEvent(message);
      if (this.inside.onmessage) this.inside.onmessage(message);
    }
    postMessage(data) {
      if (this.ready) this.send(data); else this.waiting.push(data);
    }
    terminate() {}
  };
}
