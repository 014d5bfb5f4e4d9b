// SPDX-License-Identifier: Apache-2.0
#include "client/cli/picture_window.h"

#include <dlfcn.h>

#include <opencv2/core/core_c.h>
#include <opencv2/highgui/highgui_c.h>
#include <algorithm>
#include <cstdlib>
#include <opencv2/core/version.hpp>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {
namespace {

constexpr int kPollMs = 20;  // how long a picture or a key may wait
constexpr int kEscape = 27;
constexpr int kLargestSide = 1280;  // of a window as it opens, pixels

absl::Status NotShown(absl::string_view why) { return absl::UnavailableError(absl::StrCat("--show: ", why)); }

bool IsSet(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr && *value != '\0';
}

// A shared library that stays loaded: toolkits do not bear being unloaded.
class Library {
 public:
  explicit Library(const std::string& name) : handle_(dlopen(name.c_str(), RTLD_NOW)) {}
  // The function of this type and name; null where there is none.
  template <typename F>
  F* Find(const char* name) const {
    return handle_ == nullptr ? nullptr : reinterpret_cast<F*>(dlsym(handle_, name));
  }

 private:
  void* const handle_;
};

// OpenCV's windows, of the version whose matrices these are. C functions: their names are the same everywhere.
struct Highgui {
  explicit Highgui(const Library& library)
      : named_window(library.Find<decltype(cvNamedWindow)>("cvNamedWindow")),
        resize_window(library.Find<decltype(cvResizeWindow)>("cvResizeWindow")),
        show_image(library.Find<decltype(cvShowImage)>("cvShowImage")),
        wait_key(library.Find<decltype(cvWaitKey)>("cvWaitKey")),
        window_property(library.Find<decltype(cvGetWindowProperty)>("cvGetWindowProperty")),
        destroy_window(library.Find<decltype(cvDestroyWindow)>("cvDestroyWindow")) {}
  bool complete() const {
    return named_window && resize_window && show_image && wait_key && window_property && destroy_window;
  }

  decltype(&cvNamedWindow) named_window;
  decltype(&cvResizeWindow) resize_window;
  decltype(&cvShowImage) show_image;
  decltype(&cvWaitKey) wait_key;
  decltype(&cvGetWindowProperty) window_property;
  decltype(&cvDestroyWindow) destroy_window;
};

// The toolkit ends the program where it cannot reach the display, so that is tried before. As <xcb/xcb.h> declares
// them.
absl::Status CheckDisplay() {
  if (!IsSet("DISPLAY")) {
    return IsSet("WAYLAND_DISPLAY") ? absl::OkStatus()
                                    : NotShown("there is no display, neither DISPLAY nor WAYLAND_DISPLAY is set");
  }
  const Library xcb("libxcb.so.1");
  const auto connect = xcb.Find<void*(const char*, int*)>("xcb_connect");
  const auto has_error = xcb.Find<int(void*)>("xcb_connection_has_error");
  const auto disconnect = xcb.Find<void(void*)>("xcb_disconnect");
  if (connect == nullptr || has_error == nullptr || disconnect == nullptr) return NotShown("libxcb is not installed");
  void* connection = connect(nullptr, nullptr);
  const bool reached = has_error(connection) == 0;
  disconnect(connection);
  return reached ? absl::OkStatus() : NotShown(absl::StrCat("display ", std::getenv("DISPLAY"), " cannot be reached"));
}

// One thread does all that has to do with the window, as toolkits want it.
class PictureWindow final : public PictureView {
 public:
  PictureWindow(const Highgui& gui, std::string title, std::function<void()> quit)
      : gui_(gui), title_(std::move(title)), quit_(std::move(quit)), thread_([this] { Run(); }) {}
  ~PictureWindow() override {
    {
      absl::MutexLock lock(&mutex_);
      over_ = true;
    }
    thread_.join();
  }

  void Show(const cv::Mat& picture) override {
    absl::MutexLock lock(&mutex_);
    newest_ = picture.clone();
  }

 private:
  void Run() {
    gui_.named_window(title_.c_str(), CV_WINDOW_NORMAL | CV_WINDOW_KEEPRATIO | CV_GUI_NORMAL);
    bool open = true, sized = false;
    for (cv::Mat picture; open && Take(picture);) {
      if (!picture.empty()) {
        if (!std::exchange(sized, true)) Resize(picture.size());
        const CvMat matrix = cvMat(picture);
        gui_.show_image(title_.c_str(), &matrix);
      }
      const int key = gui_.wait_key(kPollMs) & 0xFF;
      open = key != kEscape && key != 'q' && gui_.window_property(title_.c_str(), CV_WND_PROP_VISIBLE) >= 1;
    }
    if (!open) quit_();
    gui_.destroy_window(title_.c_str());
  }

  void Resize(cv::Size size) const {
    const double factor = std::min(1.0, static_cast<double>(kLargestSide) / std::max(size.width, size.height));
    gui_.resize_window(title_.c_str(), std::max(1, static_cast<int>(size.width * factor)),
                       std::max(1, static_cast<int>(size.height * factor)));
  }

  // The picture that came since; empty: none did. False when it is over.
  bool Take(cv::Mat& picture) {
    absl::MutexLock lock(&mutex_);
    picture = std::exchange(newest_, cv::Mat());
    return !over_;
  }

  const Highgui gui_;
  const std::string title_;
  const std::function<void()> quit_;
  absl::Mutex mutex_;
  cv::Mat newest_ ABSL_GUARDED_BY(mutex_);
  bool over_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<PictureView>> OpenPictureWindow(const std::string& title, std::function<void()> quit) {
  if (absl::Status display = CheckDisplay(); !display.ok()) return display;
  // Debian's numbers: 406 for version 4.6.
  const std::string version = absl::StrFormat("%d%02d", CV_VERSION_MAJOR, CV_VERSION_MINOR);
  const Highgui gui(Library(absl::StrCat("libopencv_highgui.so.", version)));
  if (!gui.complete()) return NotShown(absl::StrCat("libopencv-highgui", version, " is not installed"));
  return std::make_unique<PictureWindow>(gui, title, std::move(quit));
}

}  // namespace holdfast
