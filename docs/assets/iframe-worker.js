// On disk a browser lets no page start a worker, so the search's worker runs in a hidden frame instead. The theme's plugin
// "offline" takes such a script from a public host, unless one of this name is given; the search asks for IFrameWorker.
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(address) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.inside = frame.contentWindow;
      const load = (src) => new Promise((loaded, failed) => {
        const script = this.inside.document.createElement("script");
        Object.assign(script, { src, onload: loaded, onerror: failed });
        this.inside.document.body.append(script);
      });
      this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.inside.importScripts = (...files) => files.reduce((before, file) => before.then(() => load(file)), Promise.resolve());
      this.started = load(new URL(address, location).href);
    }

    postMessage(data) {
      this.started.then(() => this.inside.dispatchEvent(new MessageEvent("message", { data })));
    }
  };
  window.Worker = window.IFrameWorker;
}
