//! The files of the page, embedded as they stand.

/// Path, kind and content.
pub(super) const FILES: [(&str, &str, &str); 5] = [
    ("/", "text/html; charset=utf-8", include_str!("../../report/web/page.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../../report/web/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../../report/web/page.js")),
    ("/cloud.js", "text/javascript; charset=utf-8", crate::report::viewer::CLOUD),
    ("/scene.js", "text/javascript; charset=utf-8", include_str!("../../report/web/scene.js")),
];
