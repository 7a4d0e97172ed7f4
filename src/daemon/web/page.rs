//! The page, embedded as it stands in `src/web`.

use axum::Router;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;

use super::App;

const FILES: [(&str, &str, &str); 5] = [
    ("/", "text/html; charset=utf-8", include_str!("../../report/web/page.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../../report/web/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../../report/web/page.js")),
    ("/cloud.js", "text/javascript; charset=utf-8", crate::report::viewer::CLOUD),
    ("/scene.js", "text/javascript; charset=utf-8", include_str!("../../report/web/scene.js")),
];

pub(super) fn routes() -> Router<App> {
    FILES.iter().fold(Router::new(), |router, (path, kind, content)| {
        let answer = move || async move { file(kind, content) };
        router.route(path, get(answer))
    })
}

fn file(kind: &'static str, content: &'static str) -> Response {
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-cache")], content).into_response()
}
