// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

#include <array>
#include <map>
#include <string>

namespace holdfast {

// Writes the packets of a video of one track to another file, in the container that its name says, without those of
// numbers [from, to). 'sounds': so many packets of silence, of a tenth of a second each, come with it, most of them
// behind the pictures. 'options': of FFmpeg's writer.
inline void Remux(const std::string& input, const std::string& output,
                  const std::map<std::string, std::string>& options, int sounds = 0, int from = 0, int to = 0) {
  constexpr int kRate = 8000, kSamples = kRate / 10;
  AVFormatContext* in = nullptr;
  AVFormatContext* out = nullptr;
  ASSERT_EQ(avformat_open_input(&in, input.c_str(), nullptr, nullptr), 0);
  ASSERT_GE(avformat_find_stream_info(in, nullptr), 0);
  ASSERT_GE(avformat_alloc_output_context2(&out, nullptr, nullptr, output.c_str()), 0);
  AVStream* video = avformat_new_stream(out, nullptr);
  avcodec_parameters_copy(video->codecpar, in->streams[0]->codecpar);
  video->codecpar->codec_tag = 0;
  video->avg_frame_rate = in->streams[0]->avg_frame_rate;
  AVStream* sound = sounds > 0 ? avformat_new_stream(out, nullptr) : nullptr;
  if (sound != nullptr) {
    sound->codecpar->codec_type = AVMEDIA_TYPE_AUDIO;
    sound->codecpar->codec_id = AV_CODEC_ID_PCM_S16LE;
    sound->codecpar->sample_rate = kRate;
    sound->codecpar->bits_per_coded_sample = 16;
    sound->codecpar->block_align = 2;
    sound->codecpar->bit_rate = kRate * 16;
    av_channel_layout_default(&sound->codecpar->ch_layout, 1);
    sound->time_base = {1, kRate};
  }
  ASSERT_EQ(avio_open(&out->pb, output.c_str(), AVIO_FLAG_WRITE), 0);
  AVDictionary* written = nullptr;
  for (const auto& [key, value] : options) av_dict_set(&written, key.c_str(), value.c_str(), 0);
  ASSERT_GE(avformat_write_header(out, &written), 0);
  av_dict_free(&written);
  AVPacket* packet = av_packet_alloc();
  for (int number = 0; av_read_frame(in, packet) == 0; ++number) {
    packet->stream_index = 0;
    av_packet_rescale_ts(packet, in->streams[0]->time_base, video->time_base);
    const bool wanted = number < from || number >= to;
    EXPECT_EQ(wanted ? av_interleaved_write_frame(out, packet) : 0, 0);
    av_packet_unref(packet);
  }
  std::array<uint8_t, 2 * kSamples> silence{};
  for (int i = 0; i < sounds; ++i) {
    packet->data = silence.data();
    packet->size = silence.size();
    packet->stream_index = 1;
    packet->pts = packet->dts = int64_t{i} * kSamples;
    packet->duration = kSamples;
    av_packet_rescale_ts(packet, {1, kRate}, sound->time_base);
    EXPECT_EQ(av_write_frame(out, packet), 0);
    packet->data = nullptr;
    packet->size = 0;
  }
  av_packet_free(&packet);
  EXPECT_GE(av_write_trailer(out), 0);
  avio_closep(&out->pb);
  avformat_free_context(out);
  avformat_close_input(&in);
}

}  // namespace holdfast
