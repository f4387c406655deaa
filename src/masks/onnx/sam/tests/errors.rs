//! Errors are one line, and embeddings can be stored.

use super::super::{Embedding, ImagePart, Sam};
use super::{flat, networks, runtime, tiny};
use crate::{Click, MaskError, Prompt, SegmentRequest, Segmenter};
use ostra_compute::nn::{Dialect, Network, NnError};
use ostra_core::job::Progress;
use ostra_frames::Image;

fn grey() -> Image {
    Image {
        width: 40,
        height: 30,
        pixels: vec![[90; 3]; 1200],
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn networks_that_do_not_belong_together_are_rejected() {
    let runtime = runtime();
    let load = |file: &str| Network::load(&runtime, &tiny().join(file), None).unwrap();
    let (encoder, decoder) = ("sam-tiny-encoder.onnx", "sam-tiny-decoder.onnx");
    let cases = [
        (decoder, encoder, "`image_embeddings`"),
        (encoder, encoder, "`image_embeddings`"),
        (decoder, decoder, "`image` f32 [1, 3, 256, 256]"),
    ];
    for (first, second, reported) in cases {
        let text = Sam::new(Dialect::Sam, load(first), load(second))
            .unwrap_err()
            .to_string();
        assert!(
            text.contains(reported) && text.contains("another network") && !text.contains('\n'),
            "{text}"
        );
    }
    let broken = tempfile::tempdir().unwrap();
    let whole = std::fs::read(tiny().join(encoder)).unwrap();
    for name in ["sam-vit-b-encoder.onnx", "sam-vit-b-decoder.onnx"] {
        std::fs::write(broken.path().join(name), &whole[..whole.len() / 2]).unwrap();
    }
    let error = Sam::load(broken.path(), "sam-vit-b").unwrap_err();
    assert!(
        matches!(error, NnError::NotANetwork { .. }) && !error.to_string().contains('\n'),
        "{error}"
    );
    std::fs::copy(
        tiny().join(encoder),
        broken.path().join("sam-vit-b-encoder.onnx"),
    )
    .unwrap();
    let text = Sam::load(broken.path(), "sam-vit-b")
        .unwrap_err()
        .to_string();
    assert!(
        text.contains("[1, 3, 1024, 1024]") && text.contains("[1, 3, 256, 256]"),
        "{text}"
    );
    let text = Sam::load(&tiny(), "sam-vit-b").unwrap_err().to_string();
    assert!(
        text.contains("is not installed") && text.contains("ostra models install sam-vit-b"),
        "{text}"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn stored_embedding_is_read_back_unchanged() {
    let sam = networks(
        Dialect::Sam,
        &tiny(),
        "sam-tiny-encoder.onnx",
        "sam-tiny-decoder.onnx",
    );
    let part = ImagePart {
        x: 8,
        y: 4,
        width: 20,
        height: 25,
    };
    let embedding = sam.embed(&grey(), part, &Progress::default()).unwrap();
    let bytes = embedding.to_bytes();
    assert_eq!(Embedding::from_bytes(&bytes).unwrap(), embedding);
    assert_eq!(sam.frame(&embedding).unwrap().part(), part);
    for broken in [
        &bytes[..bytes.len() - 4],
        &bytes[..bytes.len() - 1],
        &bytes[..20],
        &[0; 64],
    ] {
        assert!(matches!(
            Embedding::from_bytes(broken),
            Err(MaskError::Network(_))
        ));
    }
    let flat = flat();
    let text = flat.frame(&embedding).unwrap_err().to_string();
    assert!(
        text.contains("32×16×16") && text.contains("make it again"),
        "{text}"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn parts_and_prompts_outside_the_image_are_rejected() {
    let sam = flat();
    let image = std::sync::Arc::new(grey());
    for part in [
        ImagePart {
            x: 30,
            y: 0,
            width: 11,
            height: 5,
        },
        ImagePart {
            x: 0,
            y: 0,
            width: 0,
            height: 5,
        },
    ] {
        assert!(matches!(
            sam.embed(&image, part, &Progress::default()),
            Err(MaskError::Request(_))
        ));
    }
    let frame = sam.prepare(&image, None, &Progress::default()).unwrap();
    let outside = Click {
        at_px: glam::DVec2::new(40.0, 3.0),
        include: true,
    };
    for prompt in [
        Prompt::default(),
        Prompt {
            clicks: vec![outside],
            ..Prompt::default()
        },
    ] {
        let request = SegmentRequest {
            prompt: &prompt,
            previous: None,
            taken: None,
        };
        assert!(matches!(
            frame.segment(&request, &Progress::default()),
            Err(MaskError::Request(_))
        ));
    }
    let stopped = Progress::default();
    stopped.stop();
    assert!(matches!(
        sam.prepare(&image, None, &stopped),
        Err(MaskError::Stopped(_))
    ));
}
