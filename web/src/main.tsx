// SPDX-License-Identifier: Apache-2.0
import { render } from "preact";
import { listenToKeys } from "./keys";
import * as page from "./page";
import "./style.css";
import { App } from "./view/app";

listenToKeys();
page.server.start();
render(<App />, document.getElementById("app")!);
