/* The search of a page that was opened as a file.
 *
 * Browsers start no worker from a file: address.  FrameWorker runs the worker's script in a hidden frame, with the part
 * of the Worker interface that the search uses: messages in both directions, importScripts, terminate.
 */
"use strict";

/* Run the script at `address` in the window `scope`; the promise is fulfilled once it has run. */
function loadScript(scope, address) {
  return new Promise((resolve, reject) => {
    const script = scope.document.createElement("script");
    script.src = address;
    script.onload = resolve;
    script.onerror = () => reject(new Error(`cannot load ${address}`));
    scope.document.body.append(script);
  });
}

class FrameWorker extends EventTarget {
  constructor(address) {
    super();
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    document.body.append(this.frame);
    this.scope = this.frame.contentWindow;
    // A document that was written is kept; Firefox replaces the one that a frame begins with.
    this.scope.document.open();
    this.scope.document.write("<!doctype html><body></body>");
    this.scope.document.close();
    // In a worker, these two belong to the scope.  Messages are copies and arrive later, as from a worker.
    this.scope.postMessage = (data) => this.send(this, new MessageEvent("message", { data: structuredClone(data) }));
    this.scope.importScripts = async (...addresses) => {
      for (const each of addresses) await loadScript(this.scope, each);
    };
    this.ready = loadScript(this.scope, address);
    this.ready.catch((error) => this.send(this, new ErrorEvent("error", { message: error.message, error })));
  }

  send(target, event) {
    setTimeout(() => target.dispatchEvent(event));
  }

  postMessage(data) {
    const event = new this.scope.MessageEvent("message", { data: structuredClone(data) });
    this.ready.then(() => this.send(this.scope, event)).catch(() => {}); // the failure to load was reported
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:") window.Worker = FrameWorker;
