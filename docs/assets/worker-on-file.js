// The search runs in a worker, which browsers refuse to pages opened from the disk: there an iframe does its work.
if (location.protocol === "file:") {
  window.Worker = class {
    constructor(url) {
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.frame = frame;
      const inside = frame.contentWindow;
      inside.postMessage = (data) => this.deliver(this, data);
      const script = frame.contentDocument.createElement("script");
      script.src = url;
      this.ready = new Promise((done, failed) => {
        script.onload = () => done(inside);
        script.onerror = failed;
      });
      this.ready.catch(() => this.onerror && this.onerror(new Event("error", { cancelable: true })));
      frame.contentDocument.body.append(script);
    }
    postMessage(data) {
      const copy = structuredClone(data);
      this.ready.then((inside) => this.deliver(inside, copy), () => {});
    }
    deliver(receiver, message) {
      // as between threads: a copy, which arrives when its sender is done
      const data = structuredClone(message);
      setTimeout(() => receiver.onmessage && receiver.onmessage({ data }));
    }
    terminate() {
      this.frame.remove();
    }
  };
}
