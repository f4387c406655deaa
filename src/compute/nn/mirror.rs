//! Other servers that have the files of the catalogue.

use std::env;

use super::error::NnError;

/// Server of the Hugging Face hub in the catalogue.
const HUGGING_FACE: &str = "https://huggingface.co";

/// Returns the address from which a file is downloaded.
///
/// With `OSTRA_MIRROR=https://SERVER/FOLDER`, all files come from there, under `HOST/PATH` of their
/// address. `HF_ENDPOINT` replaces the server of the Hugging Face hub, as in its own programs.
///
/// # Errors
/// Fails if a variable is not an address with https.
pub(super) fn mirrored(url: &str) -> Result<String, NnError> {
    let named = |variable: &str| env::var(variable).ok().filter(|value| !value.is_empty());
    through(
        url,
        named("OSTRA_MIRROR").as_deref(),
        named("HF_ENDPOINT").as_deref(),
    )
}

fn through(url: &str, mirror: Option<&str>, hugging_face: Option<&str>) -> Result<String, NnError> {
    let usable = |variable: &str, server: &str| {
        if server.starts_with("https://") {
            Ok(server.trim_end_matches('/').to_owned())
        } else {
            Err(NnError::Request(format!(
                "{variable} must be an address that starts with https://, got `{server}`"
            )))
        }
    };
    if let Some(mirror) = mirror {
        let mirror = usable("OSTRA_MIRROR", mirror)?;
        let path = url.split_once("://").map_or(url, |(_, path)| path);
        return Ok(format!("{mirror}/{path}"));
    }
    match (hugging_face, url.strip_prefix(HUGGING_FACE)) {
        (Some(server), Some(path)) => Ok(format!("{}{path}", usable("HF_ENDPOINT", server)?)),
        _ => Ok(url.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirrors_replace_the_server() {
        let (hub, other) = (
            "https://huggingface.co/a/b.onnx",
            "https://github.com/c.onnx",
        );
        assert_eq!(through(hub, None, None).unwrap(), hub);
        let endpoint = Some("https://hub.example/");
        assert_eq!(
            through(hub, None, endpoint).unwrap(),
            "https://hub.example/a/b.onnx"
        );
        assert_eq!(through(other, None, endpoint).unwrap(), other);
        assert_eq!(
            through(other, Some("https://lab.example/nets"), endpoint).unwrap(),
            "https://lab.example/nets/github.com/c.onnx"
        );
        let error = through(other, Some("http://lab.example"), None).unwrap_err();
        assert!(error.to_string().contains("OSTRA_MIRROR"), "{error}");
        let error = through(hub, None, Some("hub.example")).unwrap_err();
        assert!(error.to_string().contains("HF_ENDPOINT"), "{error}");
    }
}
