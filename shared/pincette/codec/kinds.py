"""Every message that travels, as the topics and questions have it."""

from pincette.topics import QUESTIONS, TOPICS

KINDS = {topic.message for topic in TOPICS} | {
    kind for question in QUESTIONS for kind in (question.request, question.reply)
}
